/* Assignment of the inks to cells in the coming layers (Lu, Zheng, Mishra 2015, IV-B).
 *
 * The first ink belongs where a cell's height lies within one of its intervals, the second elsewhere. Over the horizon
 * the surface is assumed to rise by one nominal layer at a time: the choices of a later layer do not depend on the
 * plan. */
#ifndef INKLOOP_INK_REGIONS_H
#define INKLOOP_INK_REGIONS_H

#include <stddef.h>
#include <stdint.h>

/* Height at which the ink of a cell is decided: half a layer above the surface; on it, as in the paper; or at both ends
 * of the layer, either ink being right where they differ. The middle halves the error of the printed geometry. */
enum { REGION_MIDDLE = 1, REGION_SURFACE = 2, REGION_EITHER = 3 };

/* Cell c has the intervals from offsets[c] up to and without offsets[c + 1]: bottoms <= z < tops [m], ascending, with a
 * gap between two of them. */
typedef struct {
    /* one value more than cells; NULL: there are no regions, and the first ink belongs everywhere */
    const int64_t *offsets;
    const double *bottoms, *tops;
    double step;  /* height of a nominal layer [m] */
    int32_t test; /* REGION_... */
} InkRegions;

/* Inks allowed on a cell `ahead` layers after a surface `height` [m]: bit 0 for the first ink, bit 1 for the second. */
uint16_t inks_for(const InkRegions *regions, size_t cell, double height, size_t ahead);

#endif
