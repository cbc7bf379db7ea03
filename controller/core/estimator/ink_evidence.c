#include "ink_evidence.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "median.h"
#include "near_cells.h"
#include "row_ranges.h"
#include "small_algebra.h"

static const double FORGETTING = 0.8;      /* weight of a layer against the next (by trial: 0.95 lags behind a drift) */
static const double LEAST_INCREMENT = 0.1; /* of a full layer: below it droplets go where scans read low (by trial) */
static const double STRANGE = 0.6; /* growth off by more than this share of what was expected is no ink (assumed) */
static const double STRANGE_NOISE = 3.0; /* ... and by more than so many standard deviations */
enum { LEAST_DROPLETS = 20 };            /* fewer show single droplets rather than the ink (assumed) */

enum { BLOCK = FLAT_CELLS }; /* of a row, so that what is calculated of them stays in the cache */

static size_t cells_of(const ObservedLayer *layer) {
    return layer->layer->nx * layer->layer->ny;
}

/* What share number `share` of the inks adds to some cells [m]: one height of an ink, or all three. */
static INLINED void share_adds(const InkPrior *prior, const DropletIncrements *increments, size_t cells, size_t first,
                               size_t count, size_t share, double *restrict adds) {
    if (prior->model == INK_FULL) {
        const double height = ink_height(&prior->nominal[share / ORDERS], share % ORDERS);
        const double *rate = increments->rates + share * cells + first;
        for (size_t k = 0; k < count; k++)
            adds[k] = height * rate[k];
        return;
    }
    const DropletIncrements of_ink = {.rates = increments->rates + share * ORDERS * cells};
    added_heights(&of_ink, cells, first, count, 1, &prior->nominal[share], adds);
}

static INLINED bool is_hit(const ObservedLayer *layer, size_t cell) {
    return (layer->part[cell] != 0) & (layer->seen[cell] != 0) & (layer->layer->pattern[cell] > 0);
}

static INLINED double growth_at(const ObservedLayer *layer, size_t cell) {
    return layer->scan[cell] - layer->before[cell];
}

/* What the hit cells grew by as a share of what was expected, in the middle; nothing is left of what was `added`. */
static double usual_share(const ObservedLayer *layer, double *added) {
    size_t count = 0;
    for (size_t cell = 0; cell < cells_of(layer); cell++)
        if (is_hit(layer, cell))
            added[count++] = growth_at(layer, cell) / added[cell];
    return median(added, count);
}

/* Cells of a row. */
typedef struct {
    size_t row, column, first, count; /* first: cell of the map */
} Piece;

/* The first piece of row `top` is the next one after this. */
static Piece before_row(size_t top) {
    return (Piece){.row = top};
}

/* The piece after another one, in the order of the cells; false behind the last one before row `bottom`. */
static INLINED bool next_piece(const JettedLayer *layer, size_t bottom, Piece *piece) {
    piece->column += piece->count;
    if (piece->column >= layer->ny) {
        piece->row++;
        piece->column = 0;
    }
    piece->first = piece->row * layer->ny + piece->column;
    piece->count = layer->ny - piece->column < BLOCK ? layer->ny - piece->column : BLOCK;
    return piece->row < bottom;
}

/* What share number `share` of the inks adds to a piece on a flat surface, by its rates there [m]. */
static INLINED void share_adds_flat(const InkPrior *prior, double *rates, size_t count, size_t share,
                                    double *restrict adds) {
    const DropletIncrements flat = {.rates = rates};
    share_adds(prior, &flat, FLAT_CELLS, 0, count, share, adds);
}

/* What some cells show: what each share adds, its instrument, and the growth beyond the nominal with its variance. */
typedef struct {
    double adds[SHARES_MAX][BLOCK], instrument[SHARES_MAX][BLOCK], surplus[BLOCK], variance[BLOCK];
} CellEvidence;

static INLINED void look_at(const InkPrior *prior, const ObservedLayer *layer, const uint8_t *used, double mean,
                            const Piece *piece, CellEvidence *found) {
    const size_t cells = cells_of(layer), first = piece->first, count = piece->count;
    double flat[INKS_MAX * ORDERS * FLAT_CELLS];
    flat_rates(layer->layer, prior->inks, piece->row, piece->column, count, flat);
    for (size_t k = 0; k < ink_shares(prior); k++) {
        double *instrument = found->instrument[k];
        share_adds(prior, &layer->increments, cells, first, count, k, found->adds[k]);
        share_adds_flat(prior, flat, count, k, instrument);
        for (size_t c = 0; prior->model == INK_SCALE && c < count; c++) /* what flows from cell to cell cancels */
            instrument[c] = instrument[c] > 0.0 ? mean : 0.0;
        for (size_t c = 0; c < count; c++)
            instrument[c] = used[first + c] ? instrument[c] : 0.0;
    }
    added_heights(&layer->increments, cells, first, count, prior->inks, prior->nominal, found->surplus);
    for (size_t c = 0; c < count; c++)
        found->surplus[c] = growth_at(layer, first + c) - found->surplus[c];
    innovation_variance(layer->variance, first, count, found->variance);
}

static INLINED void add_cells(size_t n, const CellEvidence *found, size_t count, InkEvidence *evidence) {
    for (size_t c = 0; c < count; c++)
        for (size_t i = 0; i < n; i++) {
            const double instrument = found->instrument[i][c];
            evidence->surplus[i] += instrument * found->surplus[c];
            for (size_t j = 0; j < n; j++) {
                evidence->response[i * n + j] += instrument * found->adds[j][c];
                evidence->covariance[i * n + j] += instrument * found->variance[c] * found->instrument[j][c];
            }
        }
}

/* The same for one share, several cells at once. */
static INLINED void add_cells_of_one(const CellEvidence *found, size_t count, InkEvidence *evidence) {
    double surplus[BLOCK], response[BLOCK], covariance[BLOCK];
    for (size_t c = 0; c < count; c++) {
        const double instrument = found->instrument[0][c];
        surplus[c] = instrument * found->surplus[c];
        response[c] = instrument * found->adds[0][c];
        covariance[c] = instrument * found->variance[c] * instrument;
    }
    evidence->surplus[0] += lane_sum(surplus, count);
    evidence->response[0] += lane_sum(response, count);
    evidence->covariance[0] += lane_sum(covariance, count);
}

static void forget(size_t n, InkEvidence *evidence) {
    for (size_t k = 0; k < n * n; k++) {
        evidence->response[k] *= FORGETTING;
        evidence->covariance[k] *= FORGETTING * FORGETTING;
    }
    for (size_t k = 0; k < n; k++)
        evidence->surplus[k] *= FORGETTING;
}

/* What a layer adds to the cells that count: those of the part that were seen. */
typedef struct {
    size_t droplets, cells;
    double added; /* [m] */
} Added;

/* What the threads that look at one layer share. */
typedef struct {
    const InkPrior *prior;
    const ObservedLayer *layer;
    Ink ink[INKS_MAX]; /* by which heights are expected */
    double usual;      /* share of these that cells grow by */
    double *expected;  /* map [m] */
    uint8_t *strange, *used;
    double mean; /* instrument of volumes, for all cells that an ink reaches alike */
    Added added[CHUNKS];
    size_t count[CHUNKS]; /* of used cells, */
    double flat[CHUNKS];  /* and what the shares add to them on a flat surface [m] */
    InkEvidence found[CHUNKS];
} Evidence;

/* Heights that are expected, and what the layer adds. */
static INLINED void expect_rows(void *context, const RowRange *range) {
    Evidence *work = context;
    const ObservedLayer *layer = work->layer;
    const size_t nx = layer->layer->nx, ny = layer->layer->ny, cells = nx * ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t begin = chunk_row(nx, chunk) * ny, end = chunk_row(nx, chunk + 1) * ny;
        Added added = {0, 0, 0.0};
        for (size_t first = begin; first < end; first += BLOCK) {
            const size_t count = end - first < BLOCK ? end - first : BLOCK;
            const uint8_t *part = layer->part + first, *seen = layer->seen + first;
            const int32_t *pattern = layer->layer->pattern + first;
            double *restrict expected = work->expected + first, adds[BLOCK];
            added_heights(&layer->increments, cells, first, count, work->prior->inks, work->ink, expected);
            for (size_t k = 0; k < count; k++) {
                const bool counts = (part[k] != 0) & (seen[k] != 0);
                adds[k] = counts ? expected[k] : 0.0;
                added.droplets += counts & (pattern[k] > 0);
                added.cells += counts;
            }
            added.added += lane_sum(adds, count);
        }
        work->added[chunk] = added;
    }
}

CLONED_ROW_WORK(expect_range, expect_rows)

/* Whether a layer adds enough to show something about its ink. */
static bool says_enough(const Evidence *work) {
    const InkPrior *prior = work->prior;
    Added all = {0, 0, 0.0};
    double full = 0.0;
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        all.droplets += work->added[chunk].droplets;
        all.cells += work->added[chunk].cells;
        all.added += work->added[chunk].added;
    }
    for (size_t k = 0; k < prior->inks; k++)
        full += prior->nominal[k].h1 + 4.0 * prior->nominal[k].h2 + 4.0 * prior->nominal[k].h3;
    return all.droplets >= LEAST_DROPLETS &&
           all.added / (double)all.cells >= LEAST_INCREMENT * full / (double)prior->inks;
}

/* Marks the cells that did not grow as usual. */
static INLINED void mark_strange_rows(void *context, const RowRange *range) {
    Evidence *work = context;
    const ObservedLayer *layer = work->layer;
    const size_t ny = layer->layer->ny, end = range->bottom * ny;
    double variance[BLOCK];
    for (size_t first = range->top * ny; first < end; first += BLOCK) {
        const size_t count = end - first < BLOCK ? end - first : BLOCK;
        uint8_t *restrict strange = work->strange + first;
        innovation_variance(layer->variance, first, count, variance);
        for (size_t k = 0; k < count; k++) {
            const size_t cell = first + k;
            const double expected = work->usual * work->expected[cell], far = STRANGE * fabs(expected);
            const double noise = STRANGE_NOISE * sqrt(variance[k]), limit = far > noise ? far : noise;
            const uint8_t is_far = fabs(growth_at(layer, cell) - expected) > limit;
            strange[k] = is_hit(layer, cell) & is_far;
        }
    }
}

CLONED_ROW_WORK(mark_strange, mark_strange_rows)

/* Marks the cells of a row of the part that were seen and grew as usual, with no strange neighbour; their number. */
static INLINED size_t mark_usual_row(const Evidence *work, size_t i) {
    const size_t nx = work->layer->layer->nx, ny = work->layer->layer->ny;
    const uint8_t *part = work->layer->part + i * ny, *seen = work->layer->seen + i * ny;
    uint8_t *used = work->used + i * ny;
    size_t count = 0;
    mark_near_row(work->strange, nx, ny, i, used);
    for (size_t j = 0; j < ny; j++) {
        used[j] = (part[j] != 0) & (seen[j] != 0) & (used[j] == 0);
        count += used[j];
    }
    return count;
}

/* What the shares add to the used cells of some rows on a flat surface [m]. */
static INLINED double flat_sum(const Evidence *work, size_t top, size_t bottom) {
    const size_t n = ink_shares(work->prior);
    double sum = 0.0, adds[BLOCK], flat[INKS_MAX * ORDERS * FLAT_CELLS];
    for (Piece piece = before_row(top); next_piece(work->layer->layer, bottom, &piece);) {
        flat_rates(work->layer->layer, work->prior->inks, piece.row, piece.column, piece.count, flat);
        for (size_t k = 0; k < n; k++) {
            share_adds_flat(work->prior, flat, piece.count, k, adds);
            for (size_t c = 0; c < piece.count; c++)
                adds[c] = work->used[piece.first + c] ? adds[c] : 0.0;
            sum += lane_sum(adds, piece.count);
        }
    }
    return sum;
}

static INLINED void mark_usual_rows(void *context, const RowRange *range) {
    Evidence *work = context;
    const size_t nx = work->layer->layer->nx;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t top = chunk_row(nx, chunk), bottom = chunk_row(nx, chunk + 1);
        work->count[chunk] = 0;
        for (size_t i = top; i < bottom; i++)
            work->count[chunk] += mark_usual_row(work, i);
        work->flat[chunk] = work->prior->model == INK_SCALE ? flat_sum(work, top, bottom) : 0.0;
    }
}

CLONED_ROW_WORK(mark_usual, mark_usual_rows)

/* Marks the cells that are used, and takes their mean instrument; false if there are none. */
static bool choose_cells(Evidence *work) {
    const JettedLayer *layer = work->layer->layer;
    size_t count = 0;
    double flat = 0.0;
    run_rows(layer->threads, layer->nx, layer->ny, mark_strange, work);
    run_rows(layer->threads, layer->nx, layer->ny, mark_usual, work);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        count += work->count[chunk];
        flat += work->flat[chunk];
    }
    work->mean = flat / (double)(count * ink_shares(work->prior));
    return count > 0;
}

static INLINED void look_at_rows(void *context, const RowRange *range) {
    Evidence *work = context;
    const size_t n = ink_shares(work->prior), nx = work->layer->layer->nx;
    CellEvidence cells;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t bottom = chunk_row(nx, chunk + 1);
        InkEvidence *found = &work->found[chunk];
        memset(found, 0, sizeof *found);
        for (Piece piece = before_row(chunk_row(nx, chunk)); next_piece(work->layer->layer, bottom, &piece);) {
            look_at(work->prior, work->layer, work->used, work->mean, &piece, &cells);
            if (n == 1)
                add_cells_of_one(&cells, piece.count, found);
            else
                add_cells(n, &cells, piece.count, found);
        }
    }
}

CLONED_ROW_WORK(look_at_range, look_at_rows)

static void add_found(size_t n, const InkEvidence *found, InkEvidence *evidence) {
    for (size_t k = 0; k < n * n; k++) {
        evidence->response[k] += found->response[k];
        evidence->covariance[k] += found->covariance[k];
    }
    for (size_t k = 0; k < n; k++)
        evidence->surplus[k] += found->surplus[k];
}

void add_ink_evidence(const InkPrior *prior, const ObservedLayer *layer, double *values, uint8_t *marks,
                      InkEvidence *evidence) {
    const size_t n = ink_shares(prior), nx = layer->layer->nx, ny = layer->layer->ny, threads = layer->layer->threads;
    Evidence work = {.prior = prior,
                     .layer = layer,
                     .usual = 1.0,
                     .expected = values,
                     .strange = marks,
                     .used = marks + cells_of(layer)};
    likeliest_inks(prior, evidence, work.ink);
    if (prior->model == INK_OFF)
        return;
    run_rows(threads, nx, ny, expect_range, &work);
    if (!says_enough(&work))
        return;
    if (is_zero(evidence->response, n * n)) {
        work.usual = usual_share(layer, values);
        run_rows(threads, nx, ny, expect_range, &work);
    }
    if (!choose_cells(&work))
        return;
    run_rows(threads, nx, ny, look_at_range, &work);
    forget(n, evidence);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        add_found(n, &work.found[chunk], evidence);
}
