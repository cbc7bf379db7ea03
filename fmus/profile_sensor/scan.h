/* Geometry of the readings of a scanning profile sensor: spot, displacement, slope. A grid is nx * ny cells in C order,
 * cell (i, j) at i * ny + j; all functions are pure. */
#ifndef INKLOOP_SCAN_H
#define INKLOOP_SCAN_H

#include <stddef.h>

/* Mean over a Gaussian spot of standard deviation `radius`, above 0, truncated at 4 of them and renormalised where it
 * extends over the border; `lines` is room for one grid. All lengths in m. */
void average_over_spot(const double *height, double *average, double *lines, size_t nx, size_t ny, double pitch,
                       double radius);

/* The surface displaced by (x, y): bilinear between cells, level beyond the border. All lengths in m. */
void displace(const double *height, double *displaced, size_t nx, size_t ny, double pitch, double x, double y);

/* Length of the gradient at cell (i, j): central differences, one-sided at the border, 0 along a single cell. */
double slope_at(const double *height, size_t nx, size_t ny, size_t i, size_t j, double pitch);

#endif
