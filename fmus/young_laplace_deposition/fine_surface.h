/* The surface of a print finer than its droplet sites: heights at the centres of sub-cells, so that the mean of a
 * cell's sub-cells is its height and nothing is lost between the two. */
#ifndef INKLOOP_FINE_SURFACE_H
#define INKLOOP_FINE_SURFACE_H

#include <stddef.h>

/* Point (i, j) lies at ((i - rim + 0.5) / per_pitch, (j - rim + 0.5) / per_pitch) pitches from the corner of the grid
 * of cells; the rim takes the liquid that flows over the border. */
typedef struct {
    size_t nx, ny;    /* cells */
    size_t per_pitch; /* points per cell along x and along y */
    double spacing;   /* of the points [m] */
    double *height;   /* [m], (columns, rows) in C order */
} FineSurface;

/* Largest spread of a droplet in pitches: the rim is as wide, and lines four apart never touch. */
enum { WIDEST_SPREAD = 2 };

size_t rim_points(const FineSurface *surface);
size_t column_count(const FineSurface *surface); /* points along x */
size_t row_count(const FineSurface *surface);    /* points along y */

/* Heights between the points, bilinear; x and y in spacings from point (0, 0), inside the map [m]. */
double height_at(const FineSurface *surface, double x, double y);

/* A continuous surface whose cell means are `cells` (nx, ny); beyond the border it continues level. */
void spread_cells(const FineSurface *surface, const double *cells);

/* The mean of every cell (nx, ny) [m]. */
void mean_cells(const FineSurface *surface, double *cells);

#endif
