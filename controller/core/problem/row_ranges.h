/* Work on the rows of a grid, in threads and by the instructions that the processor has.
 *
 * The rows are cut into chunks, the same ones for any number of threads: a sum is taken of each chunk, and these are
 * added up in their order, so that its bits do not depend on the threads. */
#ifndef INKLOOP_ROW_RANGES_H
#define INKLOOP_ROW_RANGES_H

#include <stddef.h>
#include <stdint.h>

#include "instruction_sets.h"

enum { CHUNKS = 32 };

/* The first row of a chunk. */
static inline size_t chunk_row(size_t nx, size_t chunk) {
    return nx * chunk / CHUNKS;
}

/* Range of one thread; ends excluded. */
typedef struct {
    size_t chunk, end;  /* chunks */
    size_t top, bottom; /* their rows */
    size_t thread;      /* number of the thread, from 0 */
} RowRange;

/* `context`: data shared by all threads. */
typedef void RowWork(void *context, const RowRange *range);

/* Number of threads, up to `threads`, that pay for a grid. */
size_t row_threads(size_t threads, size_t nx, size_t ny);

/* Calls `work` on ranges of rows that are all rows together; returns when all are done. */
void run_rows(size_t threads, size_t nx, size_t ny, RowWork *work, void *context);

/* Copies bytes, or sets them all to 255 where `from` is NULL, in threads, which share the first use of new memory. */
void copy_in_threads(size_t threads, void *to, const void *from, size_t bytes);

enum { LANES = 8 };

/* Sum of the lanes. */
static INLINED double sum_of_lanes(const double lane[LANES]) {
    return ((lane[0] + lane[4]) + (lane[1] + lane[5])) + ((lane[2] + lane[6]) + (lane[3] + lane[7]));
}

/* Sum of values, accumulated in lanes. */
static INLINED double lane_sum(const double *values, size_t count) {
    double lane[LANES] = {0.0};
    size_t k = 0;
    for (; k + LANES <= count; k += LANES)
        for (size_t l = 0; l < LANES; l++)
            lane[l] += values[k + l];
    for (; k < count; k++)
        lane[k % LANES] += values[k];
    return sum_of_lanes(lane);
}

/* Sum of products, accumulated in lanes. */
static INLINED double lane_dot(const double *one, const double *other, size_t count) {
    double lane[LANES] = {0.0};
    size_t k = 0;
    for (; k + LANES <= count; k += LANES)
        for (size_t l = 0; l < LANES; l++)
            lane[l] += one[k + l] * other[k + l];
    for (; k < count; k++)
        lane[k % LANES] += one[k] * other[k];
    return sum_of_lanes(lane);
}

/* Number of marks, 1 or 0, that are 1; at most as many at a time as a byte can count. */
static INLINED size_t count_marked(const uint8_t *marks, size_t count) {
    size_t sum = 0;
    for (size_t first = 0; first < count; first += UINT8_MAX) {
        const size_t some = count - first < UINT8_MAX ? count - first : UINT8_MAX;
        uint8_t marked = 0;
        for (size_t k = 0; k < some; k++)
            marked = (uint8_t)(marked + marks[first + k]);
        sum += marked;
    }
    return sum;
}

/* Defines `work` from an INLINED body, once with the baseline instructions and once with those of AVX2. */
#define CLONED_ROW_WORK(work, body)                                                                                    \
    static void work##_plain(void *context, const RowRange *range) {                                                   \
        body(context, range);                                                                                          \
    }                                                                                                                  \
    static WITH_AVX2 void work##_avx2(void *context, const RowRange *range) {                                          \
        body(context, range);                                                                                          \
    }                                                                                                                  \
    static void work(void *context, const RowRange *range) {                                                           \
        (HAS_AVX2 ? work##_avx2 : work##_plain)(context, range);                                                       \
    }

#endif
