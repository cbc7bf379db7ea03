/* Lower bounds of the cost of each flip, in a plan of one kind of droplet that is printed in one step. They exclude
 * nearly all flips and most swaps that do not help.
 *
 * The costs of many adjacent flips are computed in less than a tenth of the time of trying them (flip_costs.h).
 *
 * The cost of a height is convex: a droplet more raises the cost of the next one on the same cells, and one less lowers
 * it, by no more than their common shares times the change of the slope. So a swap costs no less than its two flips
 * less this interaction; and after a change the bounds of the flips near it fall by no more than that, which mostly
 * still excludes them. The uncertainty of a droplet on its own cell (plan_surface.h) is less than the height it leaves
 * there, so the bound holds with it. */
#ifndef INKLOOP_FLIP_BOUNDS_H
#define INKLOOP_FLIP_BOUNDS_H

#include "flip_costs.h"

enum { FLIP_REACH = 2 }; /* distance within which two cells have neighbours in common */
enum { LOSS_LANES = 8 }; /* lanes for the cells of a row within FLIP_REACH of a change */

typedef struct {
    /* map of lower bounds [m]; NaN: unknown; NULL: there are no bounds */
    float *least;
    /* largest interaction of two cells so many rows and columns apart [m] */
    float loss[FLIP_REACH + 1][FLIP_REACH + 1];
    /* the same for the cells around a change; 0 for the lanes behind */
    float near_loss[2 * FLIP_REACH + 1][LOSS_LANES];
    float sure; /* bound of the rounding [m] */
    float most; /* largest bound stored: larger ones are of no use [m] */
    FlipPrices prices;
} FlipBounds;

/* False if there is no memory. Bounds exist if the cost alone counts and there is one kind of droplets. */
bool flip_bounds_open(FlipBounds *bounds, const PlanSurface *surface);
void flip_bounds_close(FlipBounds *bounds);

/* Forgets all bounds. */
void flip_bounds_clear(FlipBounds *bounds, const PlanSurface *surface);

/* Reads the costs of the flips of a tile, wherever several of eight adjacent cells are awake for the move (see
 * tile_moves.h) and their bounds do not exclude it. Covers the cells around the tile, too. */
void flip_bounds_renew(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile, const uint8_t *awake,
                       uint8_t move);

/* Marks cells of a row of a tile, from `cell` on: with the move where they are awake for it and no bound excludes it,
 * else with 0. */
void flip_bounds_mark(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                      const uint8_t *awake, uint8_t move, uint8_t *open);

/* Updates the bounds after cell (i, j) of the plan got another value, `value`; flip: cost of undoing that, NaN:
 * unknown. */
void flip_bounds_change(FlipBounds *bounds, const PlanSurface *surface, size_t i, size_t j, unsigned value,
                        double flip);

/* Stores the cost of a flip that was tried. */
static inline void flip_bounds_put(FlipBounds *bounds, size_t cell, double cost) {
    if (bounds->least)
        bounds->least[cell] = cost > (double)bounds->most ? bounds->most : (float)cost; /* NaN stays */
}

/* Whether the flip of a cell certainly does not lower the objective. */
static inline bool is_flip_in_vain(const FlipBounds *bounds, size_t cell) {
    return bounds->least && bounds->least[cell] > bounds->sure;
}

/* The same for a swap of two cells, `rows` and `columns` apart, 0 or 1. */
static inline bool is_swap_in_vain(const FlipBounds *bounds, size_t one, size_t other, size_t rows, size_t columns) {
    return bounds->least && bounds->least[one] + bounds->least[other] > bounds->loss[rows][columns] + bounds->sure;
}

#endif
