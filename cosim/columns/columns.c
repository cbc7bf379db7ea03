#include "columns.h"

#include <stdlib.h>

int32_t inkloop_columns_interface(void) {
    return COLUMNS_INTERFACE;
}

void columns_release(void *array) {
    free(array);
}

static int32_t resize(IntervalList *list, size_t capacity) {
    double *bottom = realloc(list->bottom, capacity * sizeof *bottom);
    list->bottom = bottom ? bottom : list->bottom;
    double *top = realloc(list->top, capacity * sizeof *top);
    list->top = top ? top : list->top;
    if (!bottom || !top)
        return COLUMNS_NO_MEMORY;
    list->capacity = capacity;
    return COLUMNS_DONE;
}

int32_t interval_reserve(IntervalList *list, size_t more) {
    if (list->capacity - list->count >= more)
        return COLUMNS_DONE;
    const size_t grown = list->capacity + list->capacity / 2 + 1024;
    return resize(list, grown - list->count >= more ? grown : list->count + more);
}

void interval_trim(IntervalList *list) {
    if (list->count > 0 && list->count < list->capacity)
        (void)resize(list, list->count); /* on failure the larger arrays stay */
}

int64_t columns_check(size_t cells, size_t count, const Columns *columns) {
    const int64_t *offsets = columns->offsets;
    const double *bottom = columns->bottom, *top = columns->top;
    if (offsets[0] != 0)
        return 0;
    for (size_t cell = 0; cell < cells; cell++) {
        const int64_t first = offsets[cell], end = offsets[cell + 1];
        if (end < first || end > (int64_t)count)
            return (int64_t)cell;
        for (int64_t k = first; k < end; k++)
            if (!(bottom[k] < top[k]) || (k > first && !(top[k - 1] < bottom[k])))
                return (int64_t)cell;
    }
    return offsets[cells] == (int64_t)count ? -1 : (int64_t)cells - 1;
}

void columns_inside(const Columns *columns, size_t points, const int64_t *cell, const double *z, uint8_t *inside) {
    for (size_t n = 0; n < points; n++) {
        const int64_t c = cell ? cell[n] : (int64_t)n;
        uint8_t is_in = 0;
        if (c >= 0)
            for (int64_t k = columns->offsets[c]; k < columns->offsets[c + 1] && columns->bottom[k] <= z[n]; k++)
                is_in |= (uint8_t)(z[n] < columns->top[k]);
        inside[n] = is_in;
    }
}
