#include "dead_cells.h"

static const double WHOLE_HEAD = 0.5; /* of the part: where more brings nothing in one layer, the ink has run out */
enum { PROBE_LAYERS = 5 };            /* every so many layers the dead cells are tried again (assumed) */

bool is_head_dry(size_t dry, size_t part_cells) {
    return (double)dry > WHOLE_HEAD * (double)part_cells;
}

bool is_probe(int64_t layer) {
    return layer % PROBE_LAYERS == 0;
}
