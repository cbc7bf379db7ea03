/* Layer-to-layer height map of ink-jet printing (Lu, Zheng, Mishra 2015, eq. 3-7): the master copy.
 *
 * A grid is nx * ny cells in C order, cell (i, j) at i * ny + j. All functions are pure: heights in, heights out [m].
 * Outside the grid lies an open edge: a neighbour there takes its full share, and the share leaves the grid. */
#ifndef INKLOOP_LAYER_MAP_H
#define INKLOOP_LAYER_MAP_H

#include <stddef.h>
#include <stdint.h>

#include "cell_colour.h"
#include "ink.h"

enum {
    FOOTPRINT = 9,
    CENTRE = 4
}; /* cells that a droplet reaches: number 3 * (di + 1) + (dj + 1) is (i + di, j + dj) */

/* Eq. 5: the share of its part that a neighbour takes when the hit cell lies `rise` above it [m]. */
double taken_share(double rise, double width);

/* Surface `after` one pass on `before`, another map: every droplet of `pattern` (0 none, 1 ink[0], 2 ink[1]) on a cell
 * of `colour` acts on `before`, and their shares are added up (all heights are finite). `factor` scales each cell's
 * droplet, NULL: all 1. Returns what fell outside the grid [m]. */
double deposit_pass(const double *before, double *after, size_t nx, size_t ny, const int32_t *pattern, const Ink ink[2],
                    const double *factor, int colour);

#endif
