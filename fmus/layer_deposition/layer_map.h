/* Layer-to-layer height map of ink-jet printing (Lu, Zheng, Mishra 2015, eq. 3-7): the master copy.
 *
 * A grid is nx * ny cells in C order, cell (i, j) at i * ny + j. All functions are pure: heights in, heights out [m].
 * Outside the grid lies an open edge: a neighbour there takes its full share, and the share leaves the grid. */
#ifndef INKLOOP_LAYER_MAP_H
#define INKLOOP_LAYER_MAP_H

#include <stddef.h>
#include <stdint.h>

#include "cell_colour.h"

typedef struct {
    double h1, h2, h3; /* height added to the cell itself, to each side and to each corner neighbour [m] */
} Ink;

enum { FOOTPRINT = 9, CENTRE = 4 }; /* share[3 * (di + 1) + (dj + 1)] belongs to cell (i + di, j + dj) */

/* Eq. 5: the share of its part that a neighbour takes when the hit cell lies `rise` above it [m]. */
double taken_share(double rise, double width);

/* What one droplet at cell (i, j) adds to its 3x3 cells on the surface `height`; the nine sum to h1 + 4 h2 + 4 h3. */
void droplet_shares(const double *height, size_t nx, size_t ny, size_t i, size_t j, const Ink *ink,
                    double share[FOOTPRINT]);

/* Adds a droplet's shares to `height`; returns what fell outside the grid [m]. */
double add_shares(double *height, size_t nx, size_t ny, size_t i, size_t j, const double share[FOOTPRINT]);

/* One pass: every droplet of `pattern` (0 none, 1 ink[0], 2 ink[1]) on a cell of `colour` acts on `before`, and the sum
 * of their shares is added to `after` (a copy of `before` at entry). `factor` scales each cell's droplet, NULL: all 1.
 * Returns what fell outside the grid [m]. */
double deposit_pass(const double *before, double *after, size_t nx, size_t ny, const int32_t *pattern, const Ink ink[2],
                    const double *factor, int colour);

#endif
