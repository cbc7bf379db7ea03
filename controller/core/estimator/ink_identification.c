#include "ink_identification.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "small_algebra.h"

static const double PRIOR_STD = 0.5; /* of a share about 1; 0.2 pulls h3 to it for twenty layers (by trial) */
static const double LEAST_SHARE = 0.25, LARGEST_SHARE = 4.0; /* beyond it is something else than the ink (assumed) */
static const double SAME = 1e-9;                             /* eigenvalues below this share of the largest are 0 */

_Static_assert((int)SHARES_MAX <= (int)UNKNOWNS_MAX, "the shares are solved for together");

size_t ink_shares(const InkPrior *prior) {
    return prior->model == INK_FULL ? prior->inks * ORDERS : prior->inks;
}

/* What share number `share` moves of height `order` of an ink: all of it or nothing [m]. */
static double direction(const InkPrior *prior, size_t share, size_t ink, size_t order) {
    const bool is_moved = prior->model == INK_FULL ? share == ink * ORDERS + order : share == ink;
    return is_moved ? ink_height(&prior->nominal[ink], order) : 0.0;
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
    if (prior->model == INK_OFF || is_zero(evidence->covariance, n * n))
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
