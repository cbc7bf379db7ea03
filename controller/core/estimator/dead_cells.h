/* Cells whose droplets do not come, detected from the growth of the print itself. */
#ifndef INKLOOP_DEAD_CELLS_H
#define INKLOOP_DEAD_CELLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "instruction_sets.h"

/* Evidence from which on a cell is dead: three layers of it; by chance less than once in a million cells (Wald 1945:
 * exp -15). */
#define DEAD_EVIDENCE 15.0

#define DEAD_WEAK 0.5      /* of a droplet's volume: the least from a nozzle that is not dead (assumed) */
#define LAYER_EVIDENCE 5.0 /* of one layer at most: a single droplet that failed is no dead nozzle */

/* Evidence of a layer, times the variance. */
static INLINED double weighed_evidence(double own, double grown) {
    const double weak = DEAD_WEAK * own;
    return weak * (0.5 * weak - grown);
}

/* Logarithm of how much likelier nothing comes than a weak droplet [1] (Wald 1945; Page 1954: never below 0), of
 * `count` cells: `before` the layer, and with it in `after`.
 *
 * own: what the cell's droplet was to leave on it [m], 0 where there was none or it was not seen: such a layer is no
 * evidence, nor is one in which the head was dry; grown: what the neighbours' droplets do not explain of its growth
 * [m], with its variance [m^2]. */
static INLINED void dead_evidence(size_t count, const double *before, const double *own, const double *grown,
                                  const double *variance, double *restrict after) {
    for (size_t k = 0; k < count; k++) {
        const double weighed = weighed_evidence(own[k], grown[k]) / variance[k],
                     evidence = own[k] > 0.0 ? weighed : 0.0;
        const double raised = evidence > -LAYER_EVIDENCE ? evidence : -LAYER_EVIDENCE;
        const double sum = before[k] + (raised < LAYER_EVIDENCE ? raised : LAYER_EVIDENCE);
        const double least = sum > 0.0 ? sum : 0.0;
        after[k] = least < DEAD_EVIDENCE ? least : DEAD_EVIDENCE;
    }
}

/* How many of these cells look as if nothing came in this layer. */
static INLINED size_t count_dry(size_t count, const double *own, const double *grown) {
    size_t dry = 0;
    for (size_t k = 0; k < count; k++)
        dry += (own[k] > 0.0) & (weighed_evidence(own[k], grown[k]) > 0.0);
    return dry;
}

/* Whether so many are most of the cells of the part: then the ink has run out. */
bool is_head_dry(size_t dry, size_t part_cells);

/* Whether dead cells are tried again in layer number `layer`: a nozzle may have been cleaned. */
bool is_probe(int64_t layer);

#endif
