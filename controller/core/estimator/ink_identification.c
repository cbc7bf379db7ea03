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

enum { BLOCK = 64 }; /* cells, so that what is calculated of them stays in the cache */

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
    for (size_t cell = 0; cell < layer->cells; cell++) {
        const bool counts = layer->part[cell] && layer->seen[cell];
        droplets += counts && layer->pattern[cell] > 0;
        sum += counts ? added[cell] : 0.0;
        counted += counts;
    }
    for (size_t k = 0; k < prior->inks; k++)
        full += prior->nominal[k].h1 + 4.0 * prior->nominal[k].h2 + 4.0 * prior->nominal[k].h3;
    return droplets >= LEAST_DROPLETS && sum / (double)counted >= LEAST_INCREMENT * full / (double)prior->inks;
}

static bool is_hit(const ObservedLayer *layer, size_t cell) {
    return (layer->part[cell] != 0) & (layer->seen[cell] != 0) & (layer->pattern[cell] > 0);
}

/* What the hit cells grew by as a share of what was expected, in the middle. */
static double usual_share(const ObservedLayer *layer, const double *added, double *values) {
    size_t count = 0;
    for (size_t cell = 0; cell < layer->cells; cell++)
        if (is_hit(layer, cell))
            values[count++] = layer->growth[cell] / added[cell];
    return median(values, count);
}

/* Marks in `used` the cells of the part that were seen and grew as usual, with no strange neighbour; their number.
 */
static size_t mark_usual(const ObservedLayer *layer, const double *added, double usual, uint8_t *restrict strange,
                         uint8_t *restrict used) {
    const size_t ny = layer->ny;
    size_t count = 0;
    for (size_t cell = 0; cell < layer->cells; cell++) {
        const double expected = usual * added[cell], far = STRANGE * fabs(expected);
        const double noise = STRANGE_NOISE * sqrt(layer->variance[cell]), limit = far > noise ? far : noise;
        strange[cell] = is_hit(layer, cell) & (fabs(layer->growth[cell] - expected) > limit);
    }
    for (size_t i = 0; i < layer->cells / ny; i++) {
        const uint8_t *part = layer->part + i * ny, *seen = layer->seen + i * ny;
        uint8_t *row = used + i * ny;
        mark_near_row(strange, layer->cells / ny, ny, i, row);
        for (size_t j = 0; j < ny; j++) {
            row[j] = (part[j] != 0) & (seen[j] != 0) & (row[j] == 0);
            count += row[j];
        }
    }
    return count;
}

/* Mean over the used cells and the shares: the instrument of volumes, for all cells that an ink reaches alike. */
static double mean_instrument(const InkPrior *prior, const ObservedLayer *layer, const uint8_t *used, size_t count) {
    const size_t n = ink_shares(prior);
    double sum = 0.0, adds[SHARES_MAX][BLOCK];
    for (size_t first = 0; first < layer->cells; first += BLOCK) {
        const size_t some = layer->cells - first < BLOCK ? layer->cells - first : BLOCK;
        for (size_t k = 0; k < n; k++) {
            share_adds(prior, &layer->flat, layer->cells, first, some, k, adds[k]);
            for (size_t c = 0; c < some; c++)
                adds[k][c] = used[first + c] ? adds[k][c] : 0.0;
        }
        for (size_t c = 0; c < some; c++)
            for (size_t k = 0; k < n; k++)
                sum += adds[k][c];
    }
    return sum / (double)(count * n);
}

/* What some cells show: what each share adds, its instrument, and the growth beyond the nominal. */
typedef struct {
    double adds[SHARES_MAX][BLOCK], instrument[SHARES_MAX][BLOCK], surplus[BLOCK];
} CellEvidence;

static void look_at(const InkPrior *prior, const ObservedLayer *layer, const uint8_t *used, double mean, size_t first,
                    size_t count, CellEvidence *found) {
    for (size_t k = 0; k < ink_shares(prior); k++) {
        double *instrument = found->instrument[k];
        share_adds(prior, &layer->increments, layer->cells, first, count, k, found->adds[k]);
        share_adds(prior, &layer->flat, layer->cells, first, count, k, instrument);
        for (size_t c = 0; prior->model == INK_SCALE && c < count; c++) /* what flows from cell to cell cancels */
            instrument[c] = instrument[c] > 0.0 ? mean : 0.0;
        for (size_t c = 0; c < count; c++)
            instrument[c] = used[first + c] ? instrument[c] : 0.0;
    }
    added_heights(&layer->increments, layer->cells, first, count, prior->inks, prior->nominal, found->surplus);
    for (size_t c = 0; c < count; c++)
        found->surplus[c] = layer->growth[first + c] - found->surplus[c];
}

static void add_cells(const ObservedLayer *layer, size_t n, const CellEvidence *found, size_t first, size_t count,
                      InkEvidence *evidence) {
    for (size_t c = 0; c < count; c++)
        for (size_t i = 0; i < n; i++) {
            const double instrument = found->instrument[i][c];
            evidence->surplus[i] += instrument * found->surplus[c];
            for (size_t j = 0; j < n; j++) {
                evidence->response[i * n + j] += instrument * found->adds[j][c];
                evidence->covariance[i * n + j] += instrument * layer->variance[first + c] * found->instrument[j][c];
            }
        }
}

/* The same for one share, whose sums stay in registers. */
static void add_cells_of_one(const ObservedLayer *layer, const CellEvidence *found, size_t first, size_t count,
                             InkEvidence *evidence) {
    double surplus = evidence->surplus[0], response = evidence->response[0], covariance = evidence->covariance[0];
    for (size_t c = 0; c < count; c++) {
        const double instrument = found->instrument[0][c];
        surplus += instrument * found->surplus[c];
        response += instrument * found->adds[0][c];
        covariance += instrument * layer->variance[first + c] * instrument;
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
    const size_t n = ink_shares(prior), cells = layer->cells;
    Ink ink[INKS_MAX];
    uint8_t *strange = marks, *used = marks + cells;
    double *added = values + cells;
    CellEvidence found;
    likeliest_inks(prior, evidence, ink);
    if (prior->model == INK_OFF)
        return;
    added_heights(&layer->increments, cells, 0, cells, prior->inks, ink, added);
    if (!says_enough(prior, layer, added))
        return;
    const double usual = is_empty(evidence->response, n * n) ? usual_share(layer, added, values) : 1.0;
    const size_t count = mark_usual(layer, added, usual, strange, used);
    if (count == 0)
        return;
    const double mean = prior->model == INK_SCALE ? mean_instrument(prior, layer, used, count) : 0.0;
    forget(n, evidence);
    for (size_t first = 0; first < cells; first += BLOCK) {
        const size_t some = cells - first < BLOCK ? cells - first : BLOCK;
        look_at(prior, layer, used, mean, first, some, &found);
        if (n == 1)
            add_cells_of_one(layer, &found, first, some, evidence);
        else
            add_cells(layer, n, &found, first, some, evidence);
    }
}
