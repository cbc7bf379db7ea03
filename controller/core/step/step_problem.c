#include "step_problem.h"

#include <math.h>

#include "near_cells.h"
#include "row_ranges.h"

/* cost of a metre above the ceiling, relative to one below the target (assumed) */
static const double CEILING_COST = 100.0;
static const double CAUTION = 1.2;    /* increase of overshoot above 1 per droplet_std (by trial) */
static const double NO_CEILING = 0.4; /* above any print from droplets [m] */
static const double NO_LIMIT = 1.0;   /* largest overshoot_limit [m]: no limit */

/* The maps of a problem, which the threads fill row by row. */
typedef struct {
    const LayerStep *step;
    const SurfaceToPlan *surface;
    const HorizonProblem *problem;
    const ProblemMaps *maps;
    bool dead_are_tried; /* in the next layer */
    double squares;      /* variance of a layer whose droplets have one of 1 [m2] */
} Filling;

/* The droplets allowed on the cells in each layer. */
static void allow_droplets(void *context, const RowRange *range) {
    const Filling *filling = context;
    const LayerControllerVariables *v = filling->step->values;
    const SurfaceToPlan *surface = filling->surface;
    const InkRegions regions = ink_regions(filling->step);
    const size_t cells = cells_of(filling->step), ny = filling->problem->ny;
    unsigned levels = 0;
    for (int32_t level = 0; level < *v->drop_levels; level++)
        levels |= 1u << (level * *v->inks);
    for (size_t ahead = 0; ahead < filling->problem->layers; ahead++)
        for (size_t cell = range->top * ny; cell < range->bottom * ny; cell++) {
            const bool is_reached = v->mask[cell] && v->jettable[cell] && !surface->capped[cell];
            const bool is_jetted = is_reached && (!surface->dead[cell] || (ahead == 0 && filling->dead_are_tried));
            const unsigned inks = is_jetted ? inks_for(&regions, cell, surface->height[cell], ahead) : 0;
            filling->maps->choices[ahead * cells + cell] = (uint16_t)(inks * levels);
        }
}

static void weigh_cells(void *context, const RowRange *range) {
    const Filling *filling = context;
    const LayerControllerVariables *v = filling->step->values;
    const uint8_t *part = filling->problem->part;
    const size_t nx = filling->problem->nx, ny = filling->problem->ny;
    for (size_t cell = range->top * ny; cell < range->bottom * ny; cell++)
        filling->maps->weight[cell] = part[cell] ? 1.0 : is_near_marked(part, nx, ny, cell) ? *v->fringe_weight : 0.0;
}

/* Upper limit of the surface, over the part only: spill outside would forbid every droplet at the edge. It holds for
 * one more layer, full and on a flat surface, until the next scan. */
static void limit_cells(void *context, const RowRange *range) {
    const Filling *filling = context;
    const LayerControllerVariables *v = filling->step->values;
    const size_t ny = filling->problem->ny;
    for (size_t cell = range->top * ny; cell < range->bottom * ny; cell++) {
        const double deviation = sqrt(filling->surface->variance[cell] + DROPLET_STD * DROPLET_STD * filling->squares);
        const double limit = v->target_height[cell] + *v->overshoot_limit - *v->chance_margin * deviation;
        filling->maps->ceiling[cell] = v->mask[cell] ? limit : NO_CEILING;
    }
}

static double largest_squares(const LayerStep *step, const SurfaceToPlan *surface) {
    double squares = 0.0;
    for (int32_t k = 0; k < *step->values->inks; k++) {
        const Ink ink = surface->ink[k];
        squares = fmax(squares, ink.h1 * ink.h1 + 4.0 * (ink.h2 * ink.h2) + 4.0 * (ink.h3 * ink.h3));
    }
    return squares;
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
    Filling filling = {step, surface, &problem, maps, is_probe((int64_t)layer + 1), largest_squares(step, surface)};
    const size_t threads = (size_t)step->threads;
    run_rows(threads, problem.nx, problem.ny, allow_droplets, &filling);
    if (is_limited)
        run_rows(threads, problem.nx, problem.ny, limit_cells, &filling);
    if (has_fringe)
        run_rows(threads, problem.nx, problem.ny, weigh_cells, &filling);
    for (size_t ahead = 0; problem.passes > 1 && ahead < problem.layers; ahead++)
        layer_colours(step, layer + 1 + (int32_t)ahead, problem.colours[ahead]);
    return problem;
}

void mark_dead(const SurfaceEstimate *estimate, size_t cells, uint8_t *dead) {
    for (size_t cell = 0; cell < cells; cell++)
        dead[cell] = estimate->dead_evidence[cell] >= DEAD_EVIDENCE;
}
