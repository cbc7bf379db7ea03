/* Union, intersection and difference of columns on one grid. */
#ifndef INKLOOP_COLUMN_ALGEBRA_H
#define INKLOOP_COLUMN_ALGEBRA_H

#include "columns.h"

/* Bits of a rule: which points the result has. */
enum { POINTS_OF_FIRST_ONLY = 1, POINTS_OF_SECOND_ONLY = 2, POINTS_OF_BOTH = 4 };

/* offsets: cells + 1 of the result. COLUMNS_DONE or COLUMNS_NO_MEMORY. */
COLUMNS_API int32_t columns_combine(size_t cells, const Columns *first, const Columns *second, int32_t rule,
                                    int64_t *offsets, IntervalList *list);

#endif
