/* Passes over the rows of a scan in threads. */
#include <string.h>

#include "near_cells.h"
#include "scan_fit.h"

CellSums over_rows(const ScanEvidence *evidence, RowWork *work, const void *context) {
    CellSums all = {.count = {0}};
    memset(evidence->sums, 0, CHUNKS * sizeof all);
    run_rows(evidence->living.threads, evidence->nx, evidence->ny, work, (void *)context);
    for (const CellSums *sums = evidence->sums; sums < evidence->sums + CHUNKS; sums++) {
        for (size_t k = 0; k < CELL_COUNTS; k++)
            all.count[k] += sums->count[k];
        for (size_t k = 0; k < CELL_SUMS; k++) {
            all.sum[k] += sums->sum[k];
            if (sums->largest[k] > all.largest[k]) {
                all.largest[k] = sums->largest[k];
                all.at[k] = sums->at[k];
            }
        }
    }
    return all;
}

/* A map and the cells near its marks. */
typedef struct {
    const ScanEvidence *evidence;
    const uint8_t *from;
    uint8_t *near;
} NearMarks;

static void near_rows(void *context, const RowRange *range) {
    const NearMarks *marks = context;
    const size_t nx = marks->evidence->nx, ny = marks->evidence->ny;
    for (size_t i = range->top; i < range->bottom; i++)
        mark_near_row(marks->from, nx, ny, i, marks->near + i * ny);
}

void mark_near(const ScanEvidence *evidence, const uint8_t *from, uint8_t *near) {
    over_rows(evidence, near_rows, &(NearMarks){evidence, from, near});
}

typedef struct {
    const ScanEvidence *evidence;
    double limit;
    bool is_below;
} SlopeLimit;

static void slope_rows(void *context, const RowRange *range) {
    const SlopeLimit *of = context;
    const ScanEvidence *evidence = of->evidence;
    const double limit = of->limit;
    const bool is_below = of->is_below;
    for (size_t cell = range->top * evidence->ny; cell < range->bottom * evidence->ny; cell++)
        evidence->walls[cell] = (evidence->slopes[cell] < limit) == is_below;
}

void mark_slopes(const ScanEvidence *evidence, double limit, bool is_below) {
    over_rows(evidence, slope_rows, &(SlopeLimit){evidence, limit, is_below});
}

/* A sample of cells; `first`: number of marked cells before each chunk. */
typedef struct {
    const ScanEvidence *evidence;
    const uint8_t *one, *other;
    size_t distance, first[CHUNKS], *cells;
} CellSample;

static INLINED bool is_marked(const CellSample *sample, size_t cell) {
    return sample->one[cell] && (!sample->other || sample->other[cell]);
}

static void count_range(void *context, const RowRange *range) {
    const CellSample *sample = context;
    const size_t nx = sample->evidence->nx, ny = sample->evidence->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        size_t count = 0;
        for (size_t cell = chunk_row(nx, chunk) * ny; cell < chunk_row(nx, chunk + 1) * ny; cell++)
            count += is_marked(sample, cell);
        sample->evidence->sums[chunk].count[0] = count;
    }
}

static void sample_range(void *context, const RowRange *range) {
    const CellSample *sample = context;
    const size_t ny = sample->evidence->ny;
    size_t found = sample->first[range->chunk];
    for (size_t cell = range->top * ny; cell < range->bottom * ny; cell++)
        if (is_marked(sample, cell)) {
            if (found % sample->distance == 0)
                sample->cells[found / sample->distance] = cell;
            found++;
        }
}

size_t sample_cells(const ScanEvidence *evidence, const uint8_t *one, const uint8_t *other, size_t least, size_t most,
                    size_t *cells) {
    CellSample sample = {.evidence = evidence, .one = one, .other = other, .cells = cells};
    const size_t all = over_rows(evidence, count_range, &sample).count[0];
    if (all < least)
        return 0;
    for (size_t chunk = 1; chunk < CHUNKS; chunk++)
        sample.first[chunk] = sample.first[chunk - 1] + evidence->sums[chunk - 1].count[0];
    sample.distance = (all + most - 1) / most;
    over_rows(evidence, sample_range, &sample);
    return (all + sample.distance - 1) / sample.distance;
}
