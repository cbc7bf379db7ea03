#include "column_algebra.h"

#include <math.h>
#include <stdbool.h>

/* Ends of the intervals of one column, bottom and top in turn; an odd number of them below a point: it is inside. */
typedef struct {
    const double *bottom, *top;
    size_t next, end;
} Ends;

static Ends ends_of(const Columns *columns, size_t cell) {
    const size_t first = (size_t)columns->offsets[cell], end = (size_t)columns->offsets[cell + 1];
    return (Ends){columns->bottom, columns->top, 2 * first, 2 * end};
}

static double next_end(const Ends *ends) {
    if (ends->next == ends->end)
        return INFINITY;
    return ends->next % 2 ? ends->top[ends->next / 2] : ends->bottom[ends->next / 2];
}

/* `list` has room for as many intervals as the two columns have. */
static void combine_column(Ends a, Ends b, int32_t rule, IntervalList *list) {
    bool is_open = false;
    double bottom = 0.0;
    while (a.next < a.end || b.next < b.end) {
        const double of_a = next_end(&a), of_b = next_end(&b), z = of_a < of_b ? of_a : of_b;
        /* an end at infinity is passed too: where z is infinite, both have nothing else left */
        a.next += a.next < a.end && of_a <= z;
        b.next += b.next < b.end && of_b <= z;
        const int32_t in_a = (int32_t)(a.next % 2), in_b = (int32_t)(b.next % 2);
        const int32_t point =
            in_a && in_b ? POINTS_OF_BOTH : in_a * POINTS_OF_FIRST_ONLY + in_b * POINTS_OF_SECOND_ONLY;
        const bool is_in = (rule & point) != 0;
        if (is_in && !is_open)
            bottom = z;
        if (!is_in && is_open)
            interval_append(list, bottom, z);
        is_open = is_in;
    }
}

int32_t columns_combine(size_t cells, const Columns *first, const Columns *second, int32_t rule, int64_t *offsets,
                        IntervalList *list) {
    offsets[0] = 0;
    for (size_t cell = 0; cell < cells; cell++) {
        const Ends a = ends_of(first, cell), b = ends_of(second, cell);
        if (interval_reserve(list, (a.end - a.next + b.end - b.next) / 2))
            return COLUMNS_NO_MEMORY;
        combine_column(a, b, rule, list);
        offsets[cell + 1] = (int64_t)list->count;
    }
    interval_trim(list);
    return COLUMNS_DONE;
}
