/* Input of one pass: droplets and surface. */
#ifndef INKLOOP_DROPLET_PASS_H
#define INKLOOP_DROPLET_PASS_H

#include <stddef.h>
#include <stdint.h>

#include "pass_colour.h"

/* An ink of the layer map. */
typedef struct {
    double h1, h2, h3; /* height added to the cell itself, to each side and to each corner neighbour [m] */
} Ink;

/* Droplets of a pass, and the surface on which they fall: those of `pattern` (0 none, 1 ink[0], 2 ink[1]) on cells of
 * `colour`. `factor` scales each cell's droplet, NULL: all 1. All heights are finite. */
typedef struct {
    size_t nx, ny;
    const double *before;
    const int32_t *pattern;
    Ink ink[2];
    const double *factor;
    int colour;
} DropletPass;

#endif
