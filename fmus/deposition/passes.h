/* Passes of one layer: all cells at once, or the four colours of a 2 x 2 colouring one after the other (Lu et al. 2015,
 * section V-D), each cured before the next. */
#ifndef INKLOOP_PASSES_H
#define INKLOOP_PASSES_H

#include "kernel.h"
#include "pass_colour.h"

/* The check of a value of the variable `passes`. */
Outcome check_passes(Instance *instance, int32_t passes);

#endif
