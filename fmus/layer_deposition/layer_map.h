/* Layer-to-layer height map of ink-jet printing (Lu, Zheng, Mishra 2015, eq. 3-7): the master copy.
 *
 * A grid is nx * ny cells in C order, cell (i, j) at i * ny + j. All functions are pure: heights in, heights out [m].
 * Outside the grid lies an open edge: a neighbour there takes its full share, and the share leaves the grid. */
#ifndef INKLOOP_LAYER_MAP_H
#define INKLOOP_LAYER_MAP_H

#include "droplet_pass.h"

enum { FOOTPRINT = 9 }; /* cells that a droplet reaches: number 3 * (di + 1) + (dj + 1) is (i + di, j + dj) */

/* Eq. 5: the share of its part that a neighbour takes when the hit cell lies `rise` above it [m]. */
double taken_share(double rise, double width);

/* Rows `top` to `bottom` - 1 of the surface `after` a pass, another map than `before`. */
void deposit_rows(const DropletPass *pass, size_t top, size_t bottom, double *after);

/* Height that the droplets of a pass give to cells outside the grid [m]. */
double lost_in_pass(const DropletPass *pass);

/* Both for all rows of a pass with these members; returns the height lost [m]. */
double deposit_pass(const double *before, double *after, size_t nx, size_t ny, const int32_t *pattern, const Ink ink[2],
                    const double *factor, int colour);

#endif
