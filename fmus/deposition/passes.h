/* Passes of one layer: all cells at once, or the four colours of a 2 x 2 colouring one after the other (Lu et al. 2015,
 * section V-D), each cured before the next. */
#ifndef INKLOOP_PASSES_H
#define INKLOOP_PASSES_H

#include "cell_colour.h"
#include "kernel.h"

typedef struct {
    int32_t passes;   /* 1 or 4 */
    int64_t order;    /* of the colours: 1 raster, 2 diagonal */
    int32_t rotation; /* layer n starts rotation * n positions later in the order */
} Passes;

/* Colour of the cells that a pass (from 0 on) of layer `layer` jets, or COLOUR_ALL. */
int pass_colour(const Passes *how, int32_t layer, int pass);

/* The check of a value of the variable `passes`. */
Outcome check_passes(Instance *instance, int32_t passes);

#endif
