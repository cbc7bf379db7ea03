#include "layer_problem.h"

#include <math.h>
#include <string.h>

#include "near_cells.h"

static const double CEILING_COST = 100.0; /* a metre above the ceiling for 100 below the target (assumed) */
static const double CAUTION = 1.2;        /* overshoot above 1 for a droplet_std of 1 (by trial) */
static const double NO_CEILING = 0.4;     /* [m], higher than anything printed from droplets */

static void allow_droplets(const PlannerOptions *options, const SurfaceEstimate *estimate, int32_t layer, size_t layers,
                           uint16_t *choices) {
    const size_t cells = options->nx * options->ny;
    unsigned levels = 0;
    for (int32_t level = 0; level < options->drop_levels; level++)
        levels |= 1u << ((size_t)level * options->inks);
    for (size_t place = 0; place < layers * cells; place++) {
        const bool is_dead = estimate->dead_evidence[place % cells] >= DEAD_EVIDENCE;
        const bool is_tried = place < cells && is_probe((int64_t)layer + 1);
        const bool is_reached =
            options->part[place % cells] && options->jettable[place % cells] && !estimate->capped[place % cells];
        const unsigned inks =
            inks_for(&options->regions, place % cells, estimate->height[place % cells], place / cells);
        choices[place] = is_reached && (!is_dead || is_tried) ? (uint16_t)(inks * levels) : 0;
    }
}

/* Weights of the cells' errors, and what the surface is not to exceed. */
static void weigh_cells(const PlannerOptions *options, const SurfaceEstimate *estimate, const EstimateFigures *figures,
                        const ProblemMaps *maps) {
    const size_t cells = options->nx * options->ny;
    double squares = 0.0;
    for (size_t k = 0; k < options->inks; k++) {
        const Ink ink = figures->ink[k];
        squares = fmax(squares, ink.h1 * ink.h1 + 4.0 * (ink.h2 * ink.h2) + 4.0 * (ink.h3 * ink.h3));
    }
    for (size_t cell = 0; cell < cells; cell++) {
        const double deviation = sqrt(estimate->variance[cell] + DROPLET_STD * DROPLET_STD * squares);
        const bool is_fringe = is_near_marked(options->part, options->nx, options->ny, cell);
        maps->weight[cell] = options->part[cell] ? 1.0 : is_fringe ? options->fringe_weight : 0.0;
        maps->ceiling[cell] =
            options->part[cell] ? options->target[cell] + options->overshoot_limit - options->chance_margin * deviation
                                : NO_CEILING;
    }
}

HorizonProblem layer_problem(const PlannerOptions *options, int32_t colours[HORIZON_MAX][4],
                             const SurfaceEstimate *estimate, const EstimateFigures *figures, int32_t layer,
                             const ProblemMaps *maps) {
    const size_t layers = figures->is_foreign ? options->foreign_horizon : options->horizon;
    allow_droplets(options, estimate, layer, layers, maps->choices);
    weigh_cells(options, estimate, figures, maps);
    const double droplet_std = options->droplet_std < 0.0 ? figures->droplet_std : options->droplet_std;
    HorizonProblem problem = {.nx = options->nx,
                              .ny = options->ny,
                              .layers = layers,
                              .height = estimate->height,
                              .target = options->target,
                              .ceiling = isinf(options->overshoot_limit) ? NULL : maps->ceiling,
                              .part = options->part,
                              .weight = maps->weight,
                              .choices = maps->choices,
                              .kinds = (size_t)options->drop_levels * options->inks,
                              .alpha = options->alpha,
                              .overshoot = options->overshoot > 0.0 ? options->overshoot : 1.0 + CAUTION * droplet_std,
                              .ceiling_cost = CEILING_COST,
                              .droplet_std = droplet_std,
                              .passes = options->passes};
    for (size_t kind = 0; kind < problem.kinds; kind++) {
        const Ink ink = figures->ink[kind % options->inks];
        const double level = (double)(kind / options->inks + 1);
        problem.kind[kind] = (Ink){level * ink.h1, level * ink.h2, level * ink.h3};
    }
    if (options->passes == 4)
        memcpy(problem.colours, colours, sizeof problem.colours);
    return problem;
}
