/* Work on the rows of a grid, in threads and by the instructions that the processor has.
 *
 * The rows are cut into chunks, the same ones for any number of threads: a sum is taken of each chunk, and these are
 * added up in their order, so that its bits do not depend on the threads. */
#ifndef INKLOOP_ROW_RANGES_H
#define INKLOOP_ROW_RANGES_H

#include <stddef.h>

#include "instruction_sets.h"

enum { CHUNKS = 32 };

/* The first row of a chunk. */
static inline size_t chunk_row(size_t nx, size_t chunk) {
    return nx * chunk / CHUNKS;
}

/* What a thread works on; ends excluded. */
typedef struct {
    size_t chunk, end;  /* chunks */
    size_t top, bottom; /* their rows */
    size_t thread;      /* counted from 0 */
} RowRange;

/* `context`: what all threads share. */
typedef void RowWork(void *context, const RowRange *range);

/* How many of `threads` are worth starting for a grid. */
size_t row_threads(size_t threads, size_t nx, size_t ny);

/* Calls `work` on ranges of rows that are all rows together; returns when all are done. */
void run_rows(size_t threads, size_t nx, size_t ny, RowWork *work, void *context);

/* Sum of some values, in four lanes that are added up at once. */
static INLINED double lane_sum(const double *values, size_t count) {
    double lane[4] = {0.0, 0.0, 0.0, 0.0};
    size_t k = 0;
    for (; k + 4 <= count; k += 4)
        for (size_t l = 0; l < 4; l++)
            lane[l] += values[k + l];
    for (; k < count; k++)
        lane[k % 4] += values[k];
    return (lane[0] + lane[1]) + (lane[2] + lane[3]);
}

/* Defines `work` from a body that is INLINED: with the instructions that every processor has, and with those of AVX2.
 */
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
