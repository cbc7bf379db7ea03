/* What a sensor reads whose frame is displaced against the printer's and whose spot is wide. */
#ifndef INKLOOP_DISPLACED_SCAN_H
#define INKLOOP_DISPLACED_SCAN_H

#include <stddef.h>

/* The reading of cell (i, j) is that of the surface at (i + x, j + y) [cells], between cells by straight lines, after
 * a mean over a Gaussian spot. spread: variance of the weights of the spot over the cells [cells^2]. */
typedef struct {
    double x, y, spread;
} Displacement;

/* A scan of the surface `height` [m], maps of nx * ny cells in C order; beyond the border the surface continues as it
 * is there. `scratch` holds 2 * nx * ny. */
void displaced_scan(size_t nx, size_t ny, const double *height, Displacement displacement, double *scratch,
                    double *reading);

/* How a scan of `height` changes with x, y [m per cell] and spread [m per cell^2]: 3 * nx * ny. `scratch` holds
 * 4 * nx * ny. */
void displaced_scan_slopes(size_t nx, size_t ny, const double *height, Displacement displacement, double *scratch,
                           double *slopes);

/* Standard deviation of the Gaussian spot [cells] whose weights over the cells have this variance [cells^2]. */
double spot_radius(double spread);

#endif
