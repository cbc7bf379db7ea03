/* What the flip of each cell costs at least, in a plan of one kind of droplet that is printed in one step: enough to
 * leave out nearly all flips and most swaps that are in vain.
 *
 * The costs of many flips beside each other are read in less than a tenth of the time that trying them takes
 * (flip_costs.h).
 *
 * The cost of a height is convex: a droplet more makes the next one on the same cells dearer, and one less makes it
 * cheaper, by no more than the shares that both have in common times the change of the slope. So a swap costs no less
 * than its two flips less what they have in common; and after a change the flips near it are known to cost no less than
 * before less that, which is mostly enough to leave them out. What a droplet leaves to chance on its own cell
 * (plan_surface.h) is less than what it leaves there, and so takes nothing from that. */
#ifndef INKLOOP_FLIP_BOUNDS_H
#define INKLOOP_FLIP_BOUNDS_H

#include "flip_costs.h"

enum { FLIP_REACH = 2 }; /* cells so near have neighbours in common */
enum { LOSS_LANES = 8 }; /* cells of a row from FLIP_REACH before a change on: no less than feel it */

typedef struct {
    float *least;                                    /* a map [m]; NaN: nothing is known; NULL: there are no bounds */
    float loss[FLIP_REACH + 1][FLIP_REACH + 1];      /* of two cells so many rows and columns apart, at most [m] */
    float near_loss[2 * FLIP_REACH + 1][LOSS_LANES]; /* the same of the cells around a change; 0 of those behind */
    float sure;                                      /* more than what bounds are rounded by [m] */
    float most;                                      /* of a bound: more is of no use [m] */
    FlipPrices prices;
} FlipBounds;

/* False if there is no memory. There are bounds where the cost alone counts and there is one kind of droplets. */
bool flip_bounds_open(FlipBounds *bounds, const PlanSurface *surface);
void flip_bounds_close(FlipBounds *bounds);

/* Forgets all that is known. */
void flip_bounds_clear(FlipBounds *bounds, const PlanSurface *surface);

/* Reads the costs of the flips of a tile, wherever several of eight cells beside each other are awake for the move (see
 * tile_moves.h) and their bounds do not tell that it is in vain. Looks at the cells around the tile, too. */
void flip_bounds_renew(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile, const uint8_t *awake,
                       uint8_t move);

/* Marks cells of a row of a tile, from `cell` on: with the move where it may help, as they are awake for it and it is
 * not certainly in vain, else with 0. */
void flip_bounds_mark(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                      const uint8_t *awake, uint8_t move, uint8_t *open);

/* The plan has got this value at cell (i, j), which it had not; flip: what it costs to take that back, NaN: unknown. */
void flip_bounds_change(FlipBounds *bounds, const PlanSurface *surface, size_t i, size_t j, unsigned value,
                        double flip);

/* The flip of a cell was tried: it costs so much. */
static inline void flip_bounds_put(FlipBounds *bounds, size_t cell, double cost) {
    if (bounds->least)
        bounds->least[cell] = cost > (double)bounds->most ? bounds->most : (float)cost; /* NaN stays */
}

/* Whether the flip of a cell certainly lowers no cost. */
static inline bool is_flip_in_vain(const FlipBounds *bounds, size_t cell) {
    return bounds->least && bounds->least[cell] > bounds->sure;
}

/* The same of a swap of two cells, `rows` and `columns` apart, 0 or 1. */
static inline bool is_swap_in_vain(const FlipBounds *bounds, size_t one, size_t other, size_t rows, size_t columns) {
    return bounds->least && bounds->least[one] + bounds->least[other] > bounds->loss[rows][columns] + bounds->sure;
}

#endif
