#include "ink_evidence.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "median.h"
#include "near_cells.h"
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
        const double *rate = increments->adds + share * cells + first;
        for (size_t k = 0; k < count; k++)
            adds[k] = height * rate[k];
        return;
    }
    const Ink *unit = increments->unit;
    const DropletIncrements of_ink = {unit ? unit + share : NULL, increments->adds + share * maps_of_ink(unit) * cells,
                                      NULL, NULL};
    added_heights(&of_ink, cells, first, count, 1, &prior->nominal[share], adds);
}

static INLINED bool is_hit(const ObservedLayer *layer, size_t cell) {
    return (layer->part[cell] != 0) & (layer->seen[cell] != 0) & (layer->layer->pattern[cell] > 0);
}

static INLINED double growth_at(const ObservedLayer *layer, size_t cell) {
    return layer->scan[cell] - layer->before[cell];
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

/* What some cells show: what each share adds, its instrument, and the growth beyond the nominal with its variance. */
typedef struct {
    double adds[SHARES_MAX][BLOCK], instrument[SHARES_MAX][BLOCK], surplus[BLOCK], variance[BLOCK];
} CellEvidence;

/* Looks at a piece; returns what the shares add to its used cells on a flat surface [m]. */
static INLINED double look_at(const InkPrior *prior, const ObservedLayer *layer, const uint8_t *used,
                              const Piece *piece, CellEvidence *restrict found) {
    const size_t cells = cells_of(layer), first = piece->first, count = piece->count;
    const Ink *unit = layer->increments.unit;
    double adds[INKS_MAX * ORDERS * FLAT_CELLS], sum = 0.0;
    const DropletIncrements flat = {unit, adds, NULL, NULL};
    flat_adds(layer->layer, prior->inks, unit, piece->row, piece->column, count, adds);
    for (size_t c = 0; c < count; c++)
        found->surplus[c] = growth_at(layer, first + c);
    for (size_t k = 0; k < ink_shares(prior); k++) {
        double *instrument = found->instrument[k];
        share_adds(prior, &layer->increments, cells, first, count, k, found->adds[k]);
        for (size_t c = 0; c < count; c++)
            found->surplus[c] -= found->adds[k][c];
        share_adds(prior, &flat, FLAT_CELLS, 0, count, k, instrument);
        for (size_t c = 0; c < count; c++)
            instrument[c] = used[first + c] ? instrument[c] : 0.0;
        sum += lane_sum(instrument, count);
        for (size_t c = 0; prior->model == INK_SCALE && c < count; c++) /* what flows from cell to cell cancels */
            instrument[c] = instrument[c] > 0.0 ? 1.0 : 0.0;
    }
    innovation_variance(layer->variance, first, count, found->variance);
    return sum;
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
    double *shares;    /* map for what hit cells grew by as a share of what is expected, chunk by chunk; NULL: none */
    uint8_t *strange, *used;
    Added added[CHUNKS];
    size_t count[CHUNKS]; /* of used cells, */
    double flat[CHUNKS];  /* and what the shares add to them on a flat surface [m] */
    InkEvidence found[CHUNKS];
} Evidence;

/* Marks the cells of a block that did not grow as usual, next to what they were expected to. */
static INLINED void mark_strange(const Evidence *work, size_t first, size_t count, const double *expected) {
    const ObservedLayer *layer = work->layer;
    const double *scan = layer->scan + first, *before = layer->before + first, share = work->usual;
    const uint8_t *part = layer->part + first, *seen = layer->seen + first;
    const int32_t *pattern = layer->layer->pattern + first;
    uint8_t *restrict strange = work->strange + first;
    double limit[BLOCK], off[BLOCK];
    innovation_variance(layer->variance, first, count, limit);
    for (size_t k = 0; k < count; k++) {
        const double usual = share * expected[k], far = STRANGE * fabs(usual), noise = STRANGE_NOISE * sqrt(limit[k]);
        limit[k] = far > noise ? far : noise;
        off[k] = fabs(scan[k] - before[k] - usual);
    }
    for (size_t k = 0; k < count; k++)
        strange[k] = (part[k] != 0) & (seen[k] != 0) & (pattern[k] > 0) & (off[k] > limit[k]);
}

/* What the layer adds, cells that did not grow as usual, and shares if they are wanted. */
static INLINED void expect_rows(void *context, const RowRange *range) {
    Evidence *work = context;
    const ObservedLayer *layer = work->layer;
    const size_t nx = layer->layer->nx, ny = layer->layer->ny, cells = nx * ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t begin = chunk_row(nx, chunk) * ny, end = chunk_row(nx, chunk + 1) * ny;
        double *shares = work->shares ? work->shares + begin : NULL;
        Added added = {0, 0, 0.0};
        for (size_t first = begin; first < end; first += BLOCK) {
            const size_t count = end - first < BLOCK ? end - first : BLOCK;
            const uint8_t *part = layer->part + first, *seen = layer->seen + first;
            const int32_t *pattern = layer->layer->pattern + first;
            double expected[BLOCK], adds[BLOCK];
            added_heights(&layer->increments, cells, first, count, work->prior->inks, work->ink, expected);
            uint8_t counts[BLOCK], droplet[BLOCK];
            for (size_t k = 0; k < count; k++) {
                counts[k] = (part[k] != 0) & (seen[k] != 0);
                droplet[k] = counts[k] & (pattern[k] > 0);
            }
            for (size_t k = 0; k < count; k++)
                adds[k] = counts[k] ? expected[k] : 0.0;
            added.droplets += count_marked(droplet, count);
            added.cells += count_marked(counts, count);
            added.added += lane_sum(adds, count);
            mark_strange(work, first, count, expected);
            for (size_t k = 0; shares && k < count; k++)
                if (is_hit(layer, first + k))
                    *shares++ = growth_at(layer, first + k) / expected[k];
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
        full += full_layer_height(&prior->nominal[k]);
    return all.droplets >= LEAST_DROPLETS &&
           all.added / (double)all.cells >= LEAST_INCREMENT * full / (double)prior->inks;
}

/* The share in the middle. */
static double usual_share(const Evidence *work, double *room) {
    ValueLists lists = {.nx = work->layer->layer->nx, .ny = work->layer->layer->ny, .map = work->shares};
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        lists.lengths[chunk] = work->added[chunk].droplets;
    return median_of_lists(&lists, room);
}

/* Marks the cells of a row of the part that were seen and grew as usual, with no strange neighbour; their number. */
static INLINED size_t mark_usual_row(const Evidence *work, size_t i) {
    const size_t nx = work->layer->layer->nx, ny = work->layer->layer->ny;
    const uint8_t *part = work->layer->part + i * ny, *seen = work->layer->seen + i * ny;
    uint8_t *used = work->used + i * ny;
    mark_near_row(work->strange, nx, ny, i, used);
    for (size_t j = 0; j < ny; j++)
        used[j] = (part[j] != 0) & (seen[j] != 0) & (used[j] == 0);
    return count_marked(used, ny);
}

static INLINED void look_at_rows(void *context, const RowRange *range) {
    Evidence *work = context;
    const size_t n = ink_shares(work->prior), nx = work->layer->layer->nx;
    CellEvidence cells;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t top = chunk_row(nx, chunk), bottom = chunk_row(nx, chunk + 1);
        InkEvidence *found = &work->found[chunk];
        memset(found, 0, sizeof *found);
        work->flat[chunk] = 0.0;
        work->count[chunk] = 0;
        for (Piece piece = before_row(top); next_piece(work->layer->layer, bottom, &piece);) {
            if (piece.column == 0)
                work->count[chunk] += mark_usual_row(work, piece.row);
            work->flat[chunk] += look_at(work->prior, work->layer, work->used, &piece, &cells);
            if (n == 1)
                add_cells_of_one(&cells, piece.count, found);
            else
                add_cells(n, &cells, piece.count, found);
        }
    }
}

CLONED_ROW_WORK(look_at_range, look_at_rows)

/* Adds what was found with `mean` times the instruments. */
static void add_found(size_t n, double mean, const InkEvidence *found, InkEvidence *evidence) {
    for (size_t k = 0; k < n * n; k++) {
        evidence->response[k] += mean * found->response[k];
        evidence->covariance[k] += mean * mean * found->covariance[k];
    }
    for (size_t k = 0; k < n; k++)
        evidence->surplus[k] += mean * found->surplus[k];
}

void add_ink_evidence(const InkPrior *prior, const ObservedLayer *layer, double *values, uint8_t *marks,
                      InkEvidence *evidence) {
    const size_t n = ink_shares(prior), nx = layer->layer->nx, ny = layer->layer->ny, threads = layer->layer->threads;
    const bool is_first = is_zero(evidence->response, n * n);
    Evidence work = {.prior = prior,
                     .layer = layer,
                     .usual = 1.0,
                     .shares = is_first ? values : NULL,
                     .strange = marks,
                     .used = marks + cells_of(layer)};
    size_t count = 0;
    double flat = 0.0;
    likeliest_inks(prior, evidence, work.ink);
    if (prior->model == INK_OFF)
        return;
    run_rows(threads, nx, ny, expect_range, &work);
    if (!says_enough(&work))
        return;
    if (is_first) {
        work.usual = usual_share(&work, values + cells_of(layer));
        work.shares = NULL;
        run_rows(threads, nx, ny, expect_range, &work);
    }
    run_rows(threads, nx, ny, look_at_range, &work);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        count += work.count[chunk];
        flat += work.flat[chunk];
    }
    if (count == 0)
        return;
    forget(n, evidence);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        add_found(n, prior->model == INK_SCALE ? flat / (double)(count * n) : 1.0, &work.found[chunk], evidence);
}
