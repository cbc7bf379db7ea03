#include "dead_cells.h"

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

size_t count_dry(size_t count, const double *own, const double *grown) {
    size_t dry = 0;
    for (size_t k = 0; k < count; k++)
        dry += (own[k] > 0.0) & (weighed_evidence(own[k], grown[k]) > 0.0);
    return dry;
}

bool is_head_dry(size_t dry, size_t part_cells) {
    return (double)dry > WHOLE_HEAD * (double)part_cells;
}

void dead_evidence(size_t count, const double *before, const double *own, const double *grown, const double *variance,
                   double *after) {
    for (size_t k = 0; k < count; k++) {
        const double evidence = own[k] > 0.0 ? weighed_evidence(own[k], grown[k]) / variance[k] : 0.0;
        after[k] = within(before[k] + within(evidence, -LAYER_EVIDENCE, LAYER_EVIDENCE), 0.0, DEAD_EVIDENCE);
    }
}

bool is_probe(int64_t layer) {
    return layer % PROBE_LAYERS == 0;
}
