/* What the flip of each cell costs at least, in a plan of one kind of droplet that is printed in one step: enough to
 * leave out nine tenths of the flips and swaps that are in vain.
 *
 * The cost of a height is convex: a droplet more makes the next one on the same cells dearer, and one less makes it
 * cheaper, by no more than the shares that both have in common times the change of the slope. So a bound that was
 * found by trying a flip holds on, less so much for each change near it that can make the flip cheaper; and a swap
 * costs no less than its two flips less what they have in common. What a droplet leaves to chance on its own cell
 * (plan_surface.h) is less than what it leaves there, and so takes nothing from that. */
#ifndef INKLOOP_FLIP_BOUNDS_H
#define INKLOOP_FLIP_BOUNDS_H

#include "plan_surface.h"
#include "tile.h"

enum { FLIP_REACH = 2 }; /* cells so near have neighbours in common */

typedef struct {
    float *least;                               /* a map [m]; NaN: nothing is known; NULL: there are no bounds */
    uint8_t *is_read;                           /* by tiles: flip_bounds_read has been there since the last clear */
    size_t columns, tiles;                      /* tiles of a row, and of the grid */
    float loss[FLIP_REACH + 1][FLIP_REACH + 1]; /* of two cells so many rows and columns apart, at most [m] */
    float sure;                                 /* more than what bounds are rounded by [m] */
    float most;                                 /* of a bound: more is of no use [m] */
} FlipBounds;

/* False if there is no memory. There are bounds where the cost alone counts and there is one kind of droplets. */
bool flip_bounds_open(FlipBounds *bounds, const PlanSurface *surface);
void flip_bounds_close(FlipBounds *bounds);

/* Forgets all that is known. */
void flip_bounds_clear(FlipBounds *bounds, const PlanSurface *surface);

/* Finds the costs of all flips of a tile of which nothing is known, row by row: in a tenth of the time of trying them.
 * Reads the cells around the tile, too. */
void flip_bounds_read(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile);

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
