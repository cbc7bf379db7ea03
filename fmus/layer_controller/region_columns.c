#include "region_columns.h"

#include <math.h>

enum { INTERVALS_MAX = 64 }; /* of region_intervals in variables.toml */

typedef struct {
    double bottom, top; /* bottom <= z < top */
} Interval;

/* The intervals of a cell, ascending, those that touch or overlap joined; returns their number. */
static size_t intervals_of(const LayerControllerVariables *v, size_t cell, Interval found[INTERVALS_MAX]) {
    const size_t cells = (size_t)(*v->nx * *v->ny);
    size_t count = 0, joined = 0;
    for (size_t map = 0; map < *v->region_intervals; map++) {
        const double bottom = v->region_bottom[map * cells + cell], top = v->region_top[map * cells + cell];
        size_t place = count;
        if (bottom > top)
            continue;
        for (; place > 0 && found[place - 1].bottom > bottom; place--)
            found[place] = found[place - 1];
        found[place] = (Interval){bottom, nextafter(top, INFINITY)}; /* the top itself belongs to the region */
        count++;
    }
    for (size_t k = 0; k < count; k++) {
        if (joined == 0 || found[k].bottom > found[joined - 1].top)
            found[joined++] = found[k];
        else
            found[joined - 1].top = fmax(found[joined - 1].top, found[k].top);
    }
    return joined;
}

bool add_region(Instance *instance, LayerStep *step) {
    const LayerControllerVariables *v = step->values;
    const size_t cells = (size_t)(*v->nx * *v->ny);
    Interval found[INTERVALS_MAX];
    size_t total = 0;
    if (*v->inks == 1 || !*v->has_region)
        return true;
    for (size_t cell = 0; cell < cells; cell++)
        total += intervals_of(v, cell, found);
    int64_t *offsets = scratch_memory(instance, (cells + 1) * sizeof(int64_t) + 2 * total * sizeof(double));
    if (!offsets)
        return false;
    double *bottoms = (double *)(offsets + cells + 1), *tops = bottoms + total;
    offsets[0] = 0;
    for (size_t cell = 0; cell < cells; cell++) {
        const size_t count = intervals_of(v, cell, found);
        for (size_t k = 0; k < count; k++) {
            bottoms[(size_t)offsets[cell] + k] = found[k].bottom;
            tops[(size_t)offsets[cell] + k] = found[k].top;
        }
        offsets[cell + 1] = offsets[cell] + (int64_t)count;
    }
    step->region_offsets = offsets;
    step->region_bottoms = bottoms;
    step->region_tops = tops;
    return true;
}
