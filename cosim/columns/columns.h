/* Columns of height intervals: over each cell of a grid, bottom <= z < top [m], ascending, with a gap between two.
 * Cell c has the intervals offsets[c] .. offsets[c + 1] - 1. No state between calls, any number of threads.
 */
#ifndef INKLOOP_COLUMNS_H
#define INKLOOP_COLUMNS_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define COLUMNS_API __declspec(dllexport)
#else
#define COLUMNS_API __attribute__((visibility("default")))
#endif

enum { COLUMNS_INTERFACE = 2 }; /* counts up with every change of a signature or struct of this folder */

enum { COLUMNS_DONE = 0, COLUMNS_NO_MEMORY = 1 };

/* Intervals of cells, in the order of the cells; released by `columns_release`. Starts as all 0. */
typedef struct {
    double *bottom, *top;
    size_t count, capacity;
} IntervalList;

/* Columns of the caller, checked by `columns_check`. */
typedef struct {
    const int64_t *offsets;
    const double *bottom, *top;
} Columns;

/* COLUMNS_INTERFACE of the library: the caller can refuse one that was built for other sources. */
COLUMNS_API int32_t inkloop_columns_interface(void);

/* Frees an array that a function of this library allocated, or does nothing with NULL. */
COLUMNS_API void columns_release(void *array);

/* Makes room for `more` intervals. COLUMNS_DONE or COLUMNS_NO_MEMORY. */
int32_t interval_reserve(IntervalList *list, size_t more);

/* Appends bottom <= z < top, for which there is room. */
static inline void interval_append(IntervalList *list, double bottom, double top) {
    list->bottom[list->count] = bottom;
    list->top[list->count] = top;
    list->count += 1;
}

/* Gives back what the list does not need. */
void interval_trim(IntervalList *list);

/* First cell whose offsets or intervals do not ascend; -1 where all do. `count` is the number of intervals. */
COLUMNS_API int64_t columns_check(size_t cells, size_t count, const Columns *columns);

/* inside[n] = whether z[n] lies in an interval of cell[n], n < points; of cell n itself where `cell` is NULL. A
 * negative cell contains nothing, nor does any cell contain nan. */
COLUMNS_API void columns_inside(const Columns *columns, size_t points, const int64_t *cell, const double *z,
                                uint8_t *inside);

#endif
