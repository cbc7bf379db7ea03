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

/* Without a branch on z, which no processor can predict. */
static uint8_t column_holds(const Columns *columns, int64_t cell, double z) {
    uint8_t is_in = 0;
    for (int64_t k = columns->offsets[cell], end = columns->offsets[cell + 1]; k < end; k++)
        is_in |= (uint8_t)((columns->bottom[k] <= z) & (z < columns->top[k]));
    return is_in;
}

void columns_inside(const Columns *columns, size_t points, const int64_t *cell, const double *z, uint8_t *inside) {
    if (cell)
        for (size_t n = 0; n < points; n++)
            inside[n] = cell[n] >= 0 ? column_holds(columns, cell[n], z[n]) : 0;
    else
        for (size_t n = 0; n < points; n++)
            inside[n] = column_holds(columns, (int64_t)n, z[n]);
}
