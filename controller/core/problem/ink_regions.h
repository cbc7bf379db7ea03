/* Which ink belongs on which cell in the coming layers (Lu, Zheng, Mishra 2015, IV-B).
 *
 * The first ink belongs where a cell's height lies within one of its intervals, the second elsewhere. Over the horizon
 * the surface is taken to rise by a nominal layer at a time, wherever the droplets then fall: the choices of a later
 * layer do not depend on the plan. */
#ifndef INKLOOP_INK_REGIONS_H
#define INKLOOP_INK_REGIONS_H

#include <stddef.h>
#include <stdint.h>

/* The height at which the ink of a cell is decided: half a layer above the surface; on it, as in the paper; or both
 * ends of the layer, either ink being right where they differ. The middle halves the error of the printed geometry. */
enum { REGION_MIDDLE = 1, REGION_SURFACE = 2, REGION_EITHER = 3 };

/* Cell c has the intervals from offsets[c] up to and without offsets[c + 1]: bottoms <= z < tops [m], ascending, with a
 * gap between two of them. */
typedef struct {
    const int64_t *offsets; /* one more than cells; NULL: there are no regions, and the first ink belongs everywhere */
    const double *bottoms, *tops;
    double step;  /* height of a nominal layer [m] */
    int32_t test; /* REGION_... */
} InkRegions;

/* Bit 0 where the first ink belongs on a cell `ahead` layers after a surface `height` [m], bit 1 where the second. */
uint16_t inks_for(const InkRegions *regions, size_t cell, double height, size_t ahead);

#endif
