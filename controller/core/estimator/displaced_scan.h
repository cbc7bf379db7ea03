/* What a sensor reads whose frame is displaced against the printer's and whose spot is wide. */
#ifndef INKLOOP_DISPLACED_SCAN_H
#define INKLOOP_DISPLACED_SCAN_H

#include <stddef.h>

/* The reading of cell (i, j) is that of the surface at (i + x, j + y) [cells], between cells by straight lines, after
 * a mean over a Gaussian spot. spread: variance of the weights of the spot over the cells [cells^2]. */
typedef struct {
    double x, y, spread;
} Displacement;

/* Cells of a grid, ends excluded. */
typedef struct {
    size_t top, bottom, left, right;
} Patch;

/* `reach` cells more on every side, as far as the grid goes. */
static inline Patch patch_widened(const Patch *patch, size_t nx, size_t ny, size_t reach) {
    return (Patch){patch->top > reach ? patch->top - reach : 0, patch->bottom + reach < nx ? patch->bottom + reach : nx,
                   patch->left > reach ? patch->left - reach : 0,
                   patch->right + reach < ny ? patch->right + reach : ny};
}

enum { TAPS_MAX = 64 }; /* of a spot to each side; wider spots are cut off */

/* Weights of the cells 0, 1, ... `reach` away in a spot; reach 0: a point. */
typedef struct {
    size_t reach;
    double weights[TAPS_MAX + 1];
} Spot;

/* The spots of a displacement, and of those that the slopes are taken between. */
typedef struct {
    Displacement displacement;
    Spot spot, less, wider;
    double step; /* between the latter two [cells^2] */
} DisplacedView;

DisplacedView displaced_view(Displacement displacement);

/* Some rows of a map, from row `top` on. */
typedef struct {
    double *values;
    size_t top;
} Rows;

/* Room for the rows that a patch reads, from row `top` on: SCRATCH_MAPS times `rows` of them. */
typedef struct {
    double *values;
    size_t top, rows;
} Scratch;

enum { SCRATCH_MAPS = 4 };

static inline double *row_of(Rows map, size_t ny, size_t i) {
    return map.values + (i - map.top) * ny;
}

/* One of its maps; the last one is never used here. */
static inline Rows scratch_map(const Scratch *scratch, size_t ny, size_t number) {
    return (Rows){scratch->values + number * scratch->rows * ny, scratch->top};
}

/* The cells of `patch` of a scan of the surface `height` [m], maps of nx * ny cells in C order; beyond the border the
 * surface continues as it is there. */
void displaced_scan(size_t nx, size_t ny, const double *height, const DisplacedView *view, const Patch *patch,
                    const Scratch *scratch, Rows reading);

/* How a scan of `height` changes there with x, y [m per cell] and spread [m per cell^2]: a map each. */
void displaced_scan_slopes(size_t nx, size_t ny, const double *height, const DisplacedView *view, const Patch *patch,
                           const Scratch *scratch, const Rows slopes[3]);

/* Standard deviation of the Gaussian spot [cells] whose weights over the cells have this variance [cells^2]. */
double spot_radius(double spread);

#endif
