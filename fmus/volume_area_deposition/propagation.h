/* Volume and area of the ink in each cell, drop by drop (Wu, Chiu 2024, eq. 1-13): the master copy.
 *
 * A grid is nx * ny cells in C order. The paper's volumes, in shares of one drop, are replaced by mean heights of
 * cells: one drop is `height_scale` over one cell. The ink flows by the height of the covered part of a cell. */
#ifndef INKLOOP_PROPAGATION_H
#define INKLOOP_PROPAGATION_H

#include <stdbool.h>
#include <stddef.h>

enum { SIDE = 3, HIT = 1 }; /* the region of interest: 3 x 3 cells around the cell that is hit */

/* Shares of a drop on flat ground in a cell at the middle, side and corner of the region of interest. */
typedef struct {
    double volume[SIDE], area[SIDE]; /* [0] middle, [1] side, [2] corner; all volumes of the region sum to 1 */
} CapShares;

/* The drop as a spherical cap of volume height_scale pitch^2 on a base radius [m]. */
CapShares cap_shares(double height_scale, double base_radius, double pitch);

typedef struct {
    double height_scale;                         /* volume of a drop / area of a cell, c [m] */
    double mv_plus, mv_minus, ma_plus, ma_minus; /* gains of volume and area per height difference [1/m] */
    CapShares cap;
    bool guard;       /* a higher cell that gains ink grows its area at constant height */
    bool limit_gains; /* neighbours together gain at most one drop */
} DropModel;

typedef struct {
    const double *substrate; /* [m] */
    double *height;          /* substrate + volume of ink / cell area [m] */
    double *area;            /* share of the cell that is covered, 0..1 */
    size_t nx, ny;
} InkMap;

/* One drop of `volume` nominal volumes on cell (i, j). */
void add_drop(const InkMap *map, size_t i, size_t j, const DropModel *drop, double volume);

#endif
