/* Shares of the cells around a spherical cap on the middle of a cell in its volume. */
#ifndef INKLOOP_CAP_FOOTPRINT_H
#define INKLOOP_CAP_FOOTPRINT_H

#include "spherical_cap.h"

#include <stddef.h>
#include <stdint.h>

enum { MOST_REACH = 8 }; /* reach in cells; a drop wider than 17 cells is more likely an error */

typedef struct {
    int reach;                                    /* cells that the cap reaches into, on each side */
    double height;                                /* cap volume / cell area [m] */
    double share[MOST_REACH + 1][MOST_REACH + 1]; /* [|di|][|dj|], all together 1 */
} CapFootprint;

/* Cells from the middle that a base radius reaches into. */
double cap_reach(double base_radius, double pitch);

/* Precondition: cap_reach at most MOST_REACH. */
CapFootprint cap_footprint(const SphericalCap *cap, double pitch);

/* Adds `volume` caps on cell (i, j) to `height` (nx * ny, C order) [m]; returns the sum of heights outside the grid. */
double add_cap(double *height, size_t nx, size_t ny, size_t i, size_t j, const CapFootprint *footprint, double volume);

#endif
