#include "row_ranges.h"

#include <string.h>

#include "parallel.h"

enum { LIGHT = 8 }; /* ratio of work per cell, elsewhere in the core to here, for starting threads (assumed) */

_Static_assert((int)CHUNKS <= (int)MAX_PARALLEL, "each thread has a chunk");

typedef struct {
    RowWork *work;
    void *context;
    RowRange range;
} Share;

static void *work_on(void *handed) {
    const Share *share = handed;
    share->work(share->context, &share->range);
    return NULL;
}

size_t row_threads(size_t threads, size_t nx, size_t ny) {
    const size_t useful = useful_threads(threads, nx * ny / LIGHT);
    return useful < CHUNKS ? useful : CHUNKS;
}

void run_rows(size_t threads, size_t nx, size_t ny, RowWork *work, void *context) {
    const size_t count = row_threads(threads, nx, ny);
    Share share[CHUNKS];
    for (size_t k = 0; k < count; k++) {
        const size_t chunk = CHUNKS * k / count, end = CHUNKS * (k + 1) / count;
        share[k] = (Share){work, context, {chunk, end, chunk_row(nx, chunk), chunk_row(nx, end), k}};
    }
    run_parallel(work_on, share, sizeof *share, count);
}

typedef struct {
    char *to;
    const char *from;
    size_t bytes;
} Copy;

static void copy_range(void *context, const RowRange *range) {
    const Copy *copy = context;
    const size_t first = copy->bytes * range->chunk / CHUNKS, end = copy->bytes * range->end / CHUNKS;
    if (copy->from)
        memcpy(copy->to + first, copy->from + first, end - first);
    else
        memset(copy->to + first, UINT8_MAX, end - first);
}

void copy_in_threads(size_t threads, void *to, const void *from, size_t bytes) {
    run_rows(threads, CHUNKS, bytes / (CHUNKS * sizeof(double)), copy_range, &(Copy){to, from, bytes});
}
