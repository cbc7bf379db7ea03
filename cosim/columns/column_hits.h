/* From signed hits of a column, where a vertical line enters and leaves bodies, to intervals of height. */
#ifndef INKLOOP_COLUMN_HITS_H
#define INKLOOP_COLUMN_HITS_H

#include "columns.h"

typedef struct {
    double z;
    uint32_t cell; /* among those that are collected together */
    int32_t step;  /* of the winding number: 1 enters a body, -1 leaves one */
} Hit;

/* Result of the winding number of a column. */
typedef enum {
    COLUMN_CLOSED,    /* 0 above all hits, and a body wherever it is not 0 */
    COLUMN_OPEN,      /* not 0 above all hits; no interval was added */
    COLUMN_INSIDE_OUT /* below 0 over some height, and nowhere above 0 */
} ColumnState;

/* Sorts the hits of one column and adds the intervals in which the winding number is above 0. Where a line enters and
 * leaves at one height it enters first, so that bodies which touch are one interval. `list` has room for count / 2. */
ColumnState column_close(Hit *hits, size_t count, IntervalList *list);

/* Hits of many columns in any order; starts as all 0. */
typedef struct {
    Hit *hit;
    size_t count, capacity;
} HitList;

/* Makes room for `more` hits. COLUMNS_DONE or COLUMNS_NO_MEMORY. */
int32_t hit_reserve(HitList *list, size_t more);

/* Appends a hit, for which there is room. */
static inline void hit_append(HitList *list, double z, size_t cell, int32_t step) {
    list->hit[list->count++] = (Hit){z, (uint32_t)cell, step};
}

/* Brings the hits into the order of their cells, 0 .. cells - 1, in `sorted`; those of cell c begin at begin[c] and end
 * at begin[c + 1]. `begin` holds cells + 1. COLUMNS_DONE or COLUMNS_NO_MEMORY. */
int32_t hit_sort(const HitList *list, size_t cells, size_t *begin, HitList *sorted);

/* Union of `count` intervals in any order, bottom < z < top of cell[n], with offsets[cells + 1] of the result. Empty
 * and nan intervals are none. COLUMNS_DONE or COLUMNS_NO_MEMORY. */
COLUMNS_API int32_t columns_union(size_t cells, size_t count, const int64_t *cell, const double *bottom,
                                  const double *top, int64_t *offsets, IntervalList *list);

#endif
