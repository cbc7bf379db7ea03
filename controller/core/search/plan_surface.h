/* The surfaces of a plan, one before every step of printing and one after the last, and their objective.
 *
 * A plan is printed in steps: one for each layer, or one for each of its four passes. Every map has a frame of one
 * cell, so that no edge need be checked: it has no droplets, and lies so deep that it takes every share.
 *
 * Uncertainty, "left to chance": no later droplet corrects the last one of a cell. Its volume is uniform between
 * bounds, so the height of the cell is too, and errors and squares count with their expected values: an error e under
 * +-w as |e| or, within w, as (e^2 / w + w) / 2, and the square as w^2 / 3 more. w is the height that the droplet
 * leaves on its own cell times the bound of its volume: a droplet that fills a pit keeps all that its neighbours do not
 * take, and has the largest w. For a cell without a droplet in the last step w is that of a droplet on level ground: it
 * had one before. */
#ifndef INKLOOP_PLAN_SURFACE_H
#define INKLOOP_PLAN_SURFACE_H

#include <stdbool.h>

#include "droplet_flow.h"
#include "horizon_problem.h"
#include "objective.h"

enum { STEPS_MAX = 4 * HORIZON_MAX };
enum { MAP_MARGIN = 4 }; /* cells behind a map, so that four from any cell on can be read */

typedef struct {
    const HorizonProblem *problem;
    size_t nx, ny, stride, framed; /* stride: from row to row; framed: cells of a map */
    size_t steps, threads;
    Droplet droplet[1 + KINDS_MAX]; /* droplet of each value of a plan */
    double *height;                 /* steps + 1 maps [m] */
    double *target, *weight;        /* maps: target of the last surface [m]; weights of the errors */
    double *inside;                 /* a map: 1 in the part, 0 outside; without a fringe the same as `weight` */
    double *ceiling;                /* a map [m]; NULL: none */
    /* maps: uncertainty w of each cell [m], and cost of its height after the last step [m] */
    double *left_to_chance, *cost;
    uint8_t *plan;       /* a map for each layer: 0 nothing, 1 + k a droplet of kind k */
    double upward, skew; /* cost of an error e: weight * (upward |e| + skew e) */
    /* bound of the deviation of a droplet's volume, as a share of it; 0: not counted */
    double chance;
    double least_chance; /* w of the smallest droplet on level ground [m] */
    double reference;    /* reference of the heights in the sums [m] */
    bool is_evaluated;   /* the surfaces are those of the plan */
    Weighting weighting;
    Sums sums;
    double droplet_worth; /* worth of one droplet's own height on one cell in the objective [m] */
    double least_gain;    /* a change of the objective below minus this counts as a gain [m] */
    void *memory;
} PlanSurface;

enum { CHANGES_MAX = 2 };

typedef struct {
    size_t layer, i, j;
    unsigned value; /* new value of the plan there */
} Change;

/* Takes memory and evaluates the plan (layers * nx * ny). False if there is no memory. */
bool surface_open(PlanSurface *surface, const HorizonProblem *problem, const int32_t *plan);

/* The same, but the evaluation stops at `ends_at` by the stopwatch; *is_evaluated reports whether it was completed.
 * This and all later evaluations use `threads`; the bits do not depend on them. */
bool surface_open_until(PlanSurface *surface, const HorizonProblem *problem, const int32_t *plan, double ends_at,
                        int32_t threads, bool *is_evaluated);
void surface_close(PlanSurface *surface);

/* Evaluates all surfaces and sums of the present plan from scratch. */
void surface_evaluate(PlanSurface *surface);

/* The same; false, and the surfaces are invalid, if `ends_at` came first. */
bool surface_evaluate_until(PlanSurface *surface, double ends_at);

/* Computes the sums alone, where the surfaces are those of the plan. */
void surface_add_up(PlanSurface *surface);

/* Objective of the present plan, in its parts, from scratch. */
Objective surface_objective(PlanSurface *surface);

/* Whether the surfaces are evaluated, and belong to this plan. */
bool surface_holds(PlanSurface *surface, const int32_t *plan);

/* Sets every value of the plan, or writes them out: layers * nx * ny. The surfaces must be evaluated afterwards. */
void surface_set_plan(PlanSurface *surface, const int32_t *plan);
void surface_plan(PlanSurface *surface, int32_t *plan);

/* Index of cell (i, j) of the grid in a map with its frame. */
static inline size_t surface_cell(const PlanSurface *surface, size_t i, size_t j) {
    return (i + 1) * surface->stride + j + 1;
}

static inline double *surface_height(const PlanSurface *surface, size_t step) {
    return surface->height + step * surface->framed;
}

static inline uint8_t *surface_layer(const PlanSurface *surface, size_t layer) {
    return surface->plan + layer * surface->framed;
}

/* Whether this value of a plan is allowed on cell (i, j); 0 always is. */
static inline bool surface_allows(const PlanSurface *surface, size_t layer, size_t i, size_t j, unsigned value) {
    const uint16_t *choices = surface->problem->choices + (layer * surface->nx + i) * surface->ny + j;
    return ((2u * *choices + 1u) >> value) & 1u;
}

/* The step in which cell (i, j) of a layer is jetted. */
static inline size_t surface_step(const PlanSurface *surface, size_t layer, size_t i, size_t j) {
    if (surface->problem->passes == 1)
        return layer;
    const int32_t colour = cell_colour(i, j), *order = surface->problem->colours[layer];
    size_t pass = 0;
    while (order[pass] != colour)
        pass++;
    return 4 * layer + pass;
}

/* Uncertainty w of a cell whose last droplet keeps `kept` [m]. */
static inline double surface_chance(const PlanSurface *surface, double kept) {
    const double own = surface->chance * kept;
    return own > surface->least_chance ? own : surface->least_chance;
}

/* Cost of the height of a cell after the last step with uncertainty `chance` [m]. */
static inline double surface_cost(const PlanSurface *surface, size_t cell, double height, double chance) {
    const double error = height - surface->target[cell], size = fabs(error);
    const double expected = size < chance ? 0.5 * (error * error / chance + chance) : size;
    double cost = surface->upward * expected + surface->skew * error;
    if (surface->ceiling && height > surface->ceiling[cell])
        cost += surface->problem->ceiling_cost * (height - surface->ceiling[cell]);
    return surface->weight[cell] * cost;
}

/* Adds `sign` times the shares of a droplet at `cell` on the surface `before` to `after`, where `cell` is `there` and
 * rows are `stride` apart. Returns the height that it leaves on its own cell [m]. */
double surface_add_droplet(const PlanSurface *surface, const double *before, size_t cell, unsigned value, double sign,
                           double *after, size_t there, size_t stride);

#endif
