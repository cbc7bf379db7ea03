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

/* What share number `share` of the inks adds to a cell [m]: one height of an ink, or all three. */
static double share_adds(const InkPrior *prior, const DropletIncrements *increments, size_t cells, size_t cell,
                         size_t share) {
    if (prior->model == INK_FULL)
        return ink_height(&prior->nominal[share / ORDERS], share % ORDERS) * increments->rates[share * cells + cell];
    const DropletIncrements of_ink = {.rates = increments->rates + share * ORDERS * cells};
    return added_height(&of_ink, cells, cell, 1, &prior->nominal[share]);
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

/* Whether a layer adds enough to the cells that were seen to show something about its ink. */
static bool says_enough(const InkPrior *prior, const ObservedLayer *layer, const Ink ink[INKS_MAX]) {
    size_t droplets = 0, counted = 0;
    double sum = 0.0, full = 0.0;
    for (size_t cell = 0; cell < layer->cells; cell++) {
        if (!layer->part[cell] || !layer->seen[cell])
            continue;
        droplets += layer->pattern[cell] > 0;
        sum += added_height(&layer->increments, layer->cells, cell, prior->inks, ink);
        counted++;
    }
    for (size_t k = 0; k < prior->inks; k++)
        full += prior->nominal[k].h1 + 4.0 * prior->nominal[k].h2 + 4.0 * prior->nominal[k].h3;
    return droplets >= LEAST_DROPLETS && sum / (double)counted >= LEAST_INCREMENT * full / (double)prior->inks;
}

static bool is_hit(const ObservedLayer *layer, size_t cell) {
    return layer->part[cell] && layer->seen[cell] && layer->pattern[cell] > 0;
}

/* What the hit cells grew by as a share of what was expected, in the middle. */
static double usual_share(const InkPrior *prior, const ObservedLayer *layer, const Ink ink[INKS_MAX], double *values) {
    size_t count = 0;
    for (size_t cell = 0; cell < layer->cells; cell++)
        if (is_hit(layer, cell))
            values[count++] =
                layer->growth[cell] / added_height(&layer->increments, layer->cells, cell, prior->inks, ink);
    return median(values, count);
}

/* Marks in `used` the cells of the part that were seen and grew as usual, with no strange neighbour; their number.
 */
static size_t mark_usual(const InkPrior *prior, const ObservedLayer *layer, const Ink ink[INKS_MAX], double usual,
                         uint8_t *strange, uint8_t *used) {
    size_t count = 0;
    for (size_t cell = 0; cell < layer->cells; cell++) {
        const double expected = usual * added_height(&layer->increments, layer->cells, cell, prior->inks, ink);
        const double limit = fmax(STRANGE * fabs(expected), STRANGE_NOISE * sqrt(layer->variance[cell]));
        strange[cell] = is_hit(layer, cell) && fabs(layer->growth[cell] - expected) > limit;
    }
    for (size_t cell = 0; cell < layer->cells; cell++) {
        used[cell] = layer->part[cell] && layer->seen[cell] &&
                     !is_near_marked(strange, layer->cells / layer->ny, layer->ny, cell);
        count += used[cell];
    }
    return count;
}

/* Mean over the used cells and the shares: the instrument of volumes, for all cells that an ink reaches alike. */
static double mean_instrument(const InkPrior *prior, const ObservedLayer *layer, const uint8_t *used, size_t count) {
    const size_t n = ink_shares(prior);
    double sum = 0.0;
    for (size_t cell = 0; cell < layer->cells; cell++)
        for (size_t k = 0; used[cell] && k < n; k++)
            sum += share_adds(prior, &layer->flat, layer->cells, cell, k);
    return sum / (double)(count * n);
}

void add_ink_evidence(const InkPrior *prior, const ObservedLayer *layer, double *values, uint8_t *marks,
                      InkEvidence *evidence) {
    const size_t n = ink_shares(prior), cells = layer->cells;
    Ink ink[INKS_MAX];
    uint8_t *strange = marks, *used = marks + cells;
    likeliest_inks(prior, evidence, ink);
    if (prior->model == INK_OFF || !says_enough(prior, layer, ink))
        return;
    const double usual = is_empty(evidence->response, n * n) ? usual_share(prior, layer, ink, values) : 1.0;
    const size_t count = mark_usual(prior, layer, ink, usual, strange, used);
    if (count == 0)
        return;
    const double mean = prior->model == INK_SCALE ? mean_instrument(prior, layer, used, count) : 0.0;
    for (size_t k = 0; k < n * n; k++) {
        evidence->response[k] *= FORGETTING;
        evidence->covariance[k] *= FORGETTING * FORGETTING;
    }
    for (size_t k = 0; k < n; k++)
        evidence->surplus[k] *= FORGETTING;
    for (size_t cell = 0; cell < cells; cell++) {
        double adds[SHARES_MAX], instrument[SHARES_MAX];
        if (!used[cell])
            continue;
        for (size_t k = 0; k < n; k++) {
            adds[k] = share_adds(prior, &layer->increments, cells, cell, k);
            instrument[k] = share_adds(prior, &layer->flat, cells, cell, k);
            if (prior->model == INK_SCALE) /* what flows from one cell to the other cancels */
                instrument[k] = instrument[k] > 0.0 ? mean : 0.0;
        }
        const double surplus =
            layer->growth[cell] - added_height(&layer->increments, cells, cell, prior->inks, prior->nominal);
        for (size_t i = 0; i < n; i++) {
            evidence->surplus[i] += instrument[i] * surplus;
            for (size_t j = 0; j < n; j++) {
                evidence->response[i * n + j] += instrument[i] * adds[j];
                evidence->covariance[i * n + j] += instrument[i] * layer->variance[cell] * instrument[j];
            }
        }
    }
}
