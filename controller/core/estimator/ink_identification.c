#include "ink_identification.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "median.h"
#include "near_cells.h"
#include "small_algebra.h"

static const double PRIOR_STD = 0.5;       /* of a share about 1; 0.2 pulls h3 to it for twenty layers (by trial) */
static const double FORGETTING = 0.8;      /* weight of a layer against the next (by trial: 0.95 lags behind a drift) */
static const double LEAST_INCREMENT = 0.1; /* of a full layer: below it droplets go where scans read low (by trial) */
static const double STRANGE = 0.6; /* growth off by more than this share of what was expected is no ink (assumed) */
static const double STRANGE_NOISE = 3.0;                     /* ... and by more than so many standard deviations */
static const double LEAST_SHARE = 0.25, LARGEST_SHARE = 4.0; /* beyond it is something else than the ink (assumed) */
static const double SAME = 1e-9;                             /* eigenvalues below this share of the largest are 0 */
enum { LEAST_DROPLETS = 20 }; /* fewer show single droplets rather than the ink (assumed) */

_Static_assert((int)SHARES_MAX <= (int)UNKNOWNS_MAX, "the shares are solved for together");

size_t ink_shares(const InkPrior *prior) {
    return prior->model == INK_FULL ? prior->inks * ORDERS : prior->inks;
}

/* What share number `share` moves of height `order` of an ink: all of it or nothing [m]. */
static double direction(const InkPrior *prior, size_t share, size_t ink, size_t order) {
    const bool is_moved = prior->model == INK_FULL ? share == ink * ORDERS + order : share == ink;
    return is_moved ? ink_height(&prior->nominal[ink], order) : 0.0;
}

enum { BLOCK = FLAT_CELLS }; /* of a row, so that what is calculated of them stays in the cache */

static size_t cells_of(const ObservedLayer *layer) {
    return layer->layer->nx * layer->layer->ny;
}

/* Height that the droplets add to some cells [m]. */
static void added_heights(const DropletIncrements *increments, size_t cells, size_t first, size_t count, size_t inks,
                          const Ink ink[], double *restrict added) {
    const double *rate = increments->rates + first;
    for (size_t k = 0; k < count; k++)
        added[k] = 0.0;
    for (size_t number = 0; number < inks; number++, rate += ORDERS * cells) {
        const Ink one = ink[number];
        for (size_t k = 0; k < count; k++)
            added[k] = added[k] + one.h1 * rate[k] + one.h2 * rate[cells + k] + one.h3 * rate[2 * cells + k];
    }
}

/* What share number `share` of the inks adds to some cells [m]: one height of an ink, or all three. */
static void share_adds(const InkPrior *prior, const DropletIncrements *increments, size_t cells, size_t first,
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

static bool is_empty(const double *values, size_t count) {
    for (size_t k = 0; k < count; k++)
        if (values[k] != 0.0)
            return false;
    return true;
}

/* The normal equations of the shares' surplus over 1, with the prior. */
static void weigh_evidence(const InkEvidence *evidence, size_t n, double *information, double *surplus) {
    double precision[SHARES_MAX * SHARES_MAX], weighted[SHARES_MAX * SHARES_MAX] = {0.0};
    pseudo_inverse(n, evidence->covariance, SAME, precision);
    for (size_t i = 0; i < n; i++) /* response' precision */
        for (size_t j = 0; j < n; j++)
            for (size_t k = 0; k < n; k++)
                weighted[i * n + j] += evidence->response[k * n + i] * precision[k * n + j];
    for (size_t i = 0; i < n; i++) {
        surplus[i] = 0.0;
        for (size_t k = 0; k < n; k++)
            surplus[i] += weighted[i * n + k] * evidence->surplus[k];
        for (size_t j = 0; j < n; j++) {
            double sum = i == j ? 1.0 / (PRIOR_STD * PRIOR_STD) : 0.0;
            for (size_t k = 0; k < n; k++)
                sum += weighted[i * n + k] * evidence->response[k * n + j];
            information[i * n + j] = sum;
        }
    }
}

void likeliest_inks(const InkPrior *prior, const InkEvidence *evidence, Ink ink[INKS_MAX]) {
    const size_t n = ink_shares(prior);
    double information[SHARES_MAX * SHARES_MAX], share[SHARES_MAX];
    memcpy(ink, prior->nominal, INKS_MAX * sizeof *ink);
    if (prior->model == INK_OFF || is_empty(evidence->covariance, n * n))
        return;
    weigh_evidence(evidence, n, information, share);
    if (!solve_definite(n, information, share))
        return;
    for (size_t k = 0; k < n; k++)
        share[k] = fmin(LARGEST_SHARE, fmax(LEAST_SHARE, 1.0 + share[k]));
    for (size_t k = 0; k < prior->inks; k++) {
        double height[ORDERS] = {0.0};
        for (size_t order = 0; order < ORDERS; order++)
            for (size_t s = 0; s < n; s++)
                height[order] += share[s] * direction(prior, s, k, order);
        ink[k] = (Ink){height[0], height[1], height[2]};
    }
}

/* Whether a layer adds enough to the cells that were seen to show something about its ink; added: what it adds. */
static bool says_enough(const InkPrior *prior, const ObservedLayer *layer, const double *added) {
    size_t droplets = 0, counted = 0;
    double sum = 0.0, full = 0.0;
    for (size_t cell = 0; cell < cells_of(layer); cell++) {
        const bool counts = layer->part[cell] && layer->seen[cell];
        droplets += counts && layer->layer->pattern[cell] > 0;
        sum += counts ? added[cell] : 0.0;
        counted += counts;
    }
    for (size_t k = 0; k < prior->inks; k++)
        full += prior->nominal[k].h1 + 4.0 * prior->nominal[k].h2 + 4.0 * prior->nominal[k].h3;
    return droplets >= LEAST_DROPLETS && sum / (double)counted >= LEAST_INCREMENT * full / (double)prior->inks;
}

static bool is_hit(const ObservedLayer *layer, size_t cell) {
    return (layer->part[cell] != 0) & (layer->seen[cell] != 0) & (layer->layer->pattern[cell] > 0);
}

static double growth_at(const ObservedLayer *layer, size_t cell) {
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

/* Marks in `used` the cells of the part that were seen and grew as usual, with no strange neighbour; their number.
 */
static size_t mark_usual(const ObservedLayer *layer, const double *added, double usual, uint8_t *restrict strange,
                         uint8_t *restrict used) {
    const size_t nx = layer->layer->nx, ny = layer->layer->ny, cells = nx * ny;
    double variance[BLOCK];
    size_t count = 0;
    for (size_t first = 0; first < cells; first += BLOCK) {
        const size_t some = cells - first < BLOCK ? cells - first : BLOCK;
        innovation_variance(layer->variance, first, some, variance);
        for (size_t k = 0; k < some; k++) {
            const size_t cell = first + k;
            const double expected = usual * added[cell], far = STRANGE * fabs(expected);
            const double noise = STRANGE_NOISE * sqrt(variance[k]), limit = far > noise ? far : noise;
            const uint8_t is_far = fabs(growth_at(layer, cell) - expected) > limit;
            strange[cell] = is_hit(layer, cell) & is_far;
        }
    }
    for (size_t i = 0; i < nx; i++) {
        const uint8_t *part = layer->part + i * ny, *seen = layer->seen + i * ny;
        uint8_t *row = used + i * ny;
        mark_near_row(strange, nx, ny, i, row);
        for (size_t j = 0; j < ny; j++) {
            row[j] = (part[j] != 0) & (seen[j] != 0) & (row[j] == 0);
            count += row[j];
        }
    }
    return count;
}

/* Cells of a row. */
typedef struct {
    size_t row, column, first, count; /* first: cell of the map */
} Piece;

/* The piece after another one, in the order of the cells; false behind the last one. */
static bool next_piece(const JettedLayer *layer, Piece *piece) {
    piece->column += piece->count;
    if (piece->column >= layer->ny) {
        piece->row++;
        piece->column = 0;
    }
    piece->first = piece->row * layer->ny + piece->column;
    piece->count = layer->ny - piece->column < BLOCK ? layer->ny - piece->column : BLOCK;
    return piece->row < layer->nx;
}

/* What share number `share` of the inks adds to a piece on a flat surface, by its rates there [m]. */
static void share_adds_flat(const InkPrior *prior, double *rates, size_t count, size_t share, double *restrict adds) {
    const DropletIncrements flat = {.rates = rates};
    share_adds(prior, &flat, FLAT_CELLS, 0, count, share, adds);
}

/* Mean over the used cells and the shares: the instrument of volumes, for all cells that an ink reaches alike. */
static double mean_instrument(const InkPrior *prior, const ObservedLayer *layer, const uint8_t *used, size_t count) {
    const size_t n = ink_shares(prior);
    double sum = 0.0, adds[SHARES_MAX][BLOCK], flat[INKS_MAX * ORDERS * FLAT_CELLS];
    for (Piece piece = {0}; next_piece(layer->layer, &piece);) {
        flat_rates(layer->layer, prior->inks, piece.row, piece.column, piece.count, flat);
        for (size_t k = 0; k < n; k++) {
            share_adds_flat(prior, flat, piece.count, k, adds[k]);
            for (size_t c = 0; c < piece.count; c++)
                adds[k][c] = used[piece.first + c] ? adds[k][c] : 0.0;
        }
        for (size_t c = 0; c < piece.count; c++)
            for (size_t k = 0; k < n; k++)
                sum += adds[k][c];
    }
    return sum / (double)(count * n);
}

/* What some cells show: what each share adds, its instrument, and the growth beyond the nominal with its variance. */
typedef struct {
    double adds[SHARES_MAX][BLOCK], instrument[SHARES_MAX][BLOCK], surplus[BLOCK], variance[BLOCK];
} CellEvidence;

static void look_at(const InkPrior *prior, const ObservedLayer *layer, const uint8_t *used, double mean,
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

static void add_cells(size_t n, const CellEvidence *found, size_t count, InkEvidence *evidence) {
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

/* The same for one share, whose sums stay in registers. */
static void add_cells_of_one(const CellEvidence *found, size_t count, InkEvidence *evidence) {
    double surplus = evidence->surplus[0], response = evidence->response[0], covariance = evidence->covariance[0];
    for (size_t c = 0; c < count; c++) {
        const double instrument = found->instrument[0][c];
        surplus += instrument * found->surplus[c];
        response += instrument * found->adds[0][c];
        covariance += instrument * found->variance[c] * instrument;
    }
    evidence->surplus[0] = surplus;
    evidence->response[0] = response;
    evidence->covariance[0] = covariance;
}

static void forget(size_t n, InkEvidence *evidence) {
    for (size_t k = 0; k < n * n; k++) {
        evidence->response[k] *= FORGETTING;
        evidence->covariance[k] *= FORGETTING * FORGETTING;
    }
    for (size_t k = 0; k < n; k++)
        evidence->surplus[k] *= FORGETTING;
}

void add_ink_evidence(const InkPrior *prior, const ObservedLayer *layer, double *values, uint8_t *marks,
                      InkEvidence *evidence) {
    const size_t n = ink_shares(prior), cells = cells_of(layer);
    Ink ink[INKS_MAX];
    uint8_t *strange = marks, *used = marks + cells;
    CellEvidence found;
    double usual = 1.0;
    likeliest_inks(prior, evidence, ink);
    if (prior->model == INK_OFF)
        return;
    added_heights(&layer->increments, cells, 0, cells, prior->inks, ink, values);
    if (!says_enough(prior, layer, values))
        return;
    if (is_empty(evidence->response, n * n)) {
        usual = usual_share(layer, values);
        added_heights(&layer->increments, cells, 0, cells, prior->inks, ink, values);
    }
    const size_t count = mark_usual(layer, values, usual, strange, used);
    if (count == 0)
        return;
    const double mean = prior->model == INK_SCALE ? mean_instrument(prior, layer, used, count) : 0.0;
    forget(n, evidence);
    for (Piece piece = {0}; next_piece(layer->layer, &piece);) {
        look_at(prior, layer, used, mean, &piece, &found);
        if (n == 1)
            add_cells_of_one(&found, piece.count, evidence);
        else
            add_cells(n, &found, piece.count, evidence);
    }
}
