#include "column_hits.h"

#include <stdlib.h>
#include <string.h>

enum { FEW = 16 }; /* hits that are sorted by insertion */

static int before(const Hit *a, const Hit *b) {
    return a->z < b->z || (a->z <= b->z && a->step > b->step);
}

static int compare(const void *a, const void *b) {
    return before(b, a) - before(a, b);
}

static void sort(Hit *hits, size_t count) {
    if (count > FEW) {
        qsort(hits, count, sizeof *hits, compare);
        return;
    }
    for (size_t n = 1; n < count; n++) {
        const Hit hit = hits[n];
        size_t at = n;
        for (; at > 0 && before(&hit, &hits[at - 1]); at--)
            hits[at] = hits[at - 1];
        hits[at] = hit;
    }
}

ColumnState column_close(Hit *hits, size_t count, IntervalList *list) {
    if (count == 2 && hits[0].step + hits[1].step == 0) { /* most columns: in and out once */
        const Hit *enter = &hits[hits[0].step == -1], *leave = &hits[hits[0].step == 1];
        if (enter->z < leave->z)
            interval_append(list, enter->z, leave->z);
        return enter->z <= leave->z ? COLUMN_CLOSED : COLUMN_INSIDE_OUT;
    }
    int64_t winding = 0;
    for (size_t n = 0; n < count; n++)
        winding += hits[n].step;
    if (winding != 0)
        return COLUMN_OPEN;
    sort(hits, count);
    ColumnState state = COLUMN_CLOSED;
    double bottom = 0.0, below = 0.0;
    const size_t added = list->count;
    for (size_t n = 0; n < count; n++) {
        const double z = hits[n].z;
        if (winding < 0 && below < z)
            state = COLUMN_INSIDE_OUT;
        winding += hits[n].step;
        if (winding == 1 && hits[n].step == 1)
            bottom = z;
        if (winding == 0 && hits[n].step == -1 && bottom < z)
            interval_append(list, bottom, z);
        below = z;
    }
    return list->count > added ? COLUMN_CLOSED : state;
}

int32_t hit_reserve(HitList *list, size_t more) {
    if (list->capacity - list->count >= more)
        return COLUMNS_DONE;
    const size_t capacity = 2 * list->capacity + more + 1024;
    Hit *hit = realloc(list->hit, capacity * sizeof *hit);
    if (!hit)
        return COLUMNS_NO_MEMORY;
    list->hit = hit;
    list->capacity = capacity;
    return COLUMNS_DONE;
}

int32_t hit_sort(const HitList *list, size_t cells, size_t *begin, HitList *sorted) {
    if (sorted->capacity < list->count) {
        Hit *hit = malloc(list->capacity * sizeof *hit);
        if (!hit)
            return COLUMNS_NO_MEMORY;
        free(sorted->hit);
        sorted->hit = hit;
        sorted->capacity = list->capacity;
    }
    /* begin[c + 1] counts cell c, then is where its hits begin, and at the end where they end */
    memset(begin, 0, (cells + 1) * sizeof *begin);
    for (size_t n = 0; n < list->count; n++)
        begin[list->hit[n].cell + 1] += 1;
    size_t sum = 0;
    for (size_t cell = 0; cell < cells; cell++) {
        const size_t count = begin[cell + 1];
        begin[cell + 1] = sum;
        sum += count;
    }
    for (size_t n = 0; n < list->count; n++)
        sorted->hit[begin[list->hit[n].cell + 1]++] = list->hit[n];
    sorted->count = list->count;
    return COLUMNS_DONE;
}

static int32_t add_ends(size_t count, const int64_t *cell, const double *bottom, const double *top, HitList *hits) {
    if (hit_reserve(hits, 2 * count))
        return COLUMNS_NO_MEMORY;
    for (size_t n = 0; n < count; n++)
        if (bottom[n] < top[n]) {
            hit_append(hits, bottom[n], (size_t)cell[n], 1);
            hit_append(hits, top[n], (size_t)cell[n], -1);
        }
    return COLUMNS_DONE;
}

static int32_t close_all(size_t cells, const HitList *hits, size_t *begin, HitList *sorted, int64_t *offsets,
                         IntervalList *list) {
    if (hit_sort(hits, cells, begin, sorted) || interval_reserve(list, hits->count / 2))
        return COLUMNS_NO_MEMORY;
    offsets[0] = 0;
    for (size_t cell = 0; cell < cells; cell++) {
        const size_t first = begin[cell];
        (void)column_close(&sorted->hit[first], begin[cell + 1] - first, list);
        offsets[cell + 1] = (int64_t)list->count;
    }
    interval_trim(list);
    return COLUMNS_DONE;
}

int32_t columns_union(size_t cells, size_t count, const int64_t *cell, const double *bottom, const double *top,
                      int64_t *offsets, IntervalList *list) {
    HitList hits = {0}, sorted = {0};
    size_t *begin = malloc((cells + 1) * sizeof *begin);
    int32_t result = COLUMNS_NO_MEMORY;
    if (begin && !add_ends(count, cell, bottom, top, &hits))
        result = close_all(cells, &hits, begin, &sorted, offsets, list);
    free(begin);
    free(hits.hit);
    free(sorted.hit);
    return result;
}
