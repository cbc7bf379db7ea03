#include "step_problem.h"

#include <math.h>

#include "near_cells.h"

/* cost of a metre above the ceiling, relative to one below the target (assumed) */
static const double CEILING_COST = 100.0;
static const double CAUTION = 1.2;    /* increase of overshoot above 1 per droplet_std (by trial) */
static const double NO_CEILING = 0.4; /* above any print from droplets [m] */
static const double NO_LIMIT = 1.0;   /* largest overshoot_limit [m]: no limit */

/* The droplets allowed on the cells in the layer `ahead` layers after the next one. */
static void allow_droplets(const LayerStep *step, const SurfaceToPlan *surface, size_t ahead, bool dead_are_tried,
                           uint16_t *choices) {
    const LayerControllerVariables *v = step->values;
    const InkRegions regions = ink_regions(step);
    const size_t cells = cells_of(step);
    unsigned levels = 0;
    for (int32_t level = 0; level < *v->drop_levels; level++)
        levels |= 1u << (level * *v->inks);
    for (size_t cell = 0; cell < cells; cell++) {
        const bool is_reached = v->mask[cell] && v->jettable[cell] && !surface->capped[cell];
        const bool is_jetted = is_reached && (!surface->dead[cell] || dead_are_tried);
        const unsigned inks = is_jetted ? inks_for(&regions, cell, surface->height[cell], ahead) : 0;
        choices[cell] = (uint16_t)(inks * levels);
    }
}

static void weigh_cells(const LayerStep *step, double *weight) {
    const LayerControllerVariables *v = step->values;
    const uint8_t *part = (const uint8_t *)v->mask;
    for (size_t cell = 0; cell < cells_of(step); cell++) {
        const bool is_fringe = is_near_marked(part, (size_t)*v->nx, (size_t)*v->ny, cell);
        weight[cell] = part[cell] ? 1.0 : is_fringe ? *v->fringe_weight : 0.0;
    }
}

/* Upper limit of the surface, over the part only: spill outside would forbid every droplet at the edge. It holds for
 * one more layer, full and on a flat surface, until the next scan. */
static void limit_cells(const LayerStep *step, const SurfaceToPlan *surface, double *ceiling) {
    const LayerControllerVariables *v = step->values;
    double squares = 0.0;
    for (int32_t k = 0; k < *v->inks; k++) {
        const Ink ink = surface->ink[k];
        squares = fmax(squares, ink.h1 * ink.h1 + 4.0 * (ink.h2 * ink.h2) + 4.0 * (ink.h3 * ink.h3));
    }
    for (size_t cell = 0; cell < cells_of(step); cell++) {
        const double deviation = sqrt(surface->variance[cell] + DROPLET_STD * DROPLET_STD * squares);
        const double limit = v->target_height[cell] + *v->overshoot_limit - *v->chance_margin * deviation;
        ceiling[cell] = v->mask[cell] ? limit : NO_CEILING;
    }
}

static void add_kinds(const LayerStep *step, const Ink ink[INKS_MAX], HorizonProblem *problem) {
    const size_t inks = (size_t)*step->values->inks;
    problem->kinds = (size_t)*step->values->drop_levels * inks;
    for (size_t kind = 0; kind < problem->kinds; kind++) {
        const Ink *drop = &ink[kind % inks];
        const double level = (double)(kind / inks + 1);
        problem->kind[kind] = (Ink){level * drop->h1, level * drop->h2, level * drop->h3};
    }
}

HorizonProblem layer_problem(const LayerStep *step, const SurfaceToPlan *surface, int32_t layer,
                             const ProblemMaps *maps) {
    const LayerControllerVariables *v = step->values;
    const double droplet_std = *v->droplet_std < 0.0 ? surface->droplet_std : *v->droplet_std;
    const bool is_limited = *v->overshoot_limit < NO_LIMIT, has_fringe = *v->fringe_weight > 0.0;
    HorizonProblem problem = {.nx = (size_t)*v->nx,
                              .ny = (size_t)*v->ny,
                              .layers = horizon_of(step, surface->is_foreign),
                              .height = surface->height,
                              .target = v->target_height,
                              .ceiling = is_limited ? maps->ceiling : NULL,
                              .part = (const uint8_t *)v->mask,
                              .weight = has_fringe ? maps->weight : NULL,
                              .choices = maps->choices,
                              .alpha = *v->alpha,
                              .overshoot = *v->overshoot > 0.0 ? *v->overshoot : 1.0 + CAUTION * droplet_std,
                              .ceiling_cost = CEILING_COST,
                              .droplet_std = droplet_std,
                              .passes = *v->passes};
    add_kinds(step, surface->ink, &problem);
    for (size_t ahead = 0; ahead < problem.layers; ahead++)
        allow_droplets(step, surface, ahead, ahead == 0 && is_probe((int64_t)layer + 1),
                       maps->choices + ahead * cells_of(step));
    if (is_limited)
        limit_cells(step, surface, maps->ceiling);
    if (has_fringe)
        weigh_cells(step, maps->weight);
    for (size_t ahead = 0; problem.passes > 1 && ahead < problem.layers; ahead++)
        layer_colours(step, layer + 1 + (int32_t)ahead, problem.colours[ahead]);
    return problem;
}

void mark_dead(const SurfaceEstimate *estimate, size_t cells, uint8_t *dead) {
    for (size_t cell = 0; cell < cells; cell++)
        dead[cell] = estimate->dead_evidence[cell] >= DEAD_EVIDENCE;
}
