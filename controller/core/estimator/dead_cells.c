#include "dead_cells.h"

#include <math.h>
#include <string.h>

static const double WEAK = 0.5; /* of a droplet's volume: the least from a nozzle that is not dead (assumed) */
static const double LAYER_EVIDENCE = 5.0; /* of one layer at most: a single droplet that failed is no dead nozzle */
static const double WHOLE_HEAD = 0.5;     /* of the part: where more brings nothing in one layer, the ink has run out */
enum { PROBE_LAYERS = 5 };                /* every so many layers the dead cells are tried again (assumed) */

static double within(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

/* Evidence of a layer, times the variance. */
static double weighed_evidence(double own, double grown) {
    const double weak = WEAK * own;
    return weak * (0.5 * weak - grown);
}

void dead_evidence(size_t cells, const double *before, const double *own, const double *grown, const double *variance,
                   size_t part_cells, double *after) {
    size_t without = 0;
    for (size_t cell = 0; cell < cells; cell++)
        without += own[cell] > 0.0 && weighed_evidence(own[cell], grown[cell]) > 0.0;
    const bool is_whole_head = (double)without > WHOLE_HEAD * (double)part_cells;
    for (size_t cell = 0; cell < cells; cell++) {
        const double weighed = weighed_evidence(own[cell], grown[cell]);
        const double evidence = own[cell] > 0.0 ? weighed / variance[cell] : 0.0;
        after[cell] = is_whole_head ? before[cell]
                                    : within(before[cell] + within(evidence, -LAYER_EVIDENCE, LAYER_EVIDENCE), 0.0,
                                             DEAD_EVIDENCE);
    }
}

bool is_probe(int64_t layer) {
    return layer % PROBE_LAYERS == 0;
}
