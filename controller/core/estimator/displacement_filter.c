#include "displacement_filter.h"

#include <math.h>
#include <string.h>

#include "normal_equations.h"
#include "small_algebra.h"

/* Of the spread from scan to scan [cells^2]; of the predicted growth [1] before and after the ink is learnt (assumed).
 */
static const double SPREAD_STEP_STD = 1e-3, INK_FIRST_STD = 0.3, INK_STD = 0.03;
static const double LARGEST_SHIFT = 4.0, LARGEST_SPREAD = 16.0; /* [cells, cells^2] (assumed) */
static const double CONVERGED = 1e-4;                           /* [cells] */
enum { ROUNDS = 8, REWEIGHTINGS = 2, ROUNDS_WITH_OUTLIERS = 3 };
_Static_assert((int)UNKNOWNS <= (int)UNKNOWNS_MAX, "they are solved for together");

static double within(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

/* Precision of the unknowns before the scan. */
static bool prior_precision(const ScanEvidence *evidence, const Registration *registration, double *precision) {
    double covariance[DISPLACEMENTS * DISPLACEMENTS], inverse[DISPLACEMENTS * DISPLACEMENTS];
    memcpy(covariance, registration->covariance, sizeof covariance);
    covariance[SPREAD * DISPLACEMENTS + SPREAD] += SPREAD_STEP_STD * SPREAD_STEP_STD;
    if (!invert_definite(DISPLACEMENTS, covariance, inverse))
        return false;
    memset(precision, 0, UNKNOWNS * UNKNOWNS * sizeof *precision);
    for (size_t i = 0; i < DISPLACEMENTS; i++)
        for (size_t j = 0; j < DISPLACEMENTS; j++)
            precision[i * UNKNOWNS + j] = inverse[i * DISPLACEMENTS + j];
    for (size_t k = STEP; k < GROWTH; k++)
        precision[k * UNKNOWNS + k] = 1.0 / registration->steps_variance;
    const double growth = evidence->is_first_layer ? INK_FIRST_STD : INK_STD;
    precision[GROWTH * UNKNOWNS + GROWTH] = 1.0 / (growth * growth);
    return true;
}

static void keep_within(double x[UNKNOWNS]) {
    for (size_t k = 0; k < SHIFTS; k++)
        x[k] = within(x[k], -LARGEST_SHIFT, LARGEST_SHIFT);
    x[SPREAD] = within(x[SPREAD], 0.0, LARGEST_SPREAD);
}

/* The equations with the precision of the unknowns `before` the scan, about x. */
static void add_prior(const double *precision, const double *before, const double *x, const NormalSums *sums,
                      double *matrix, double side[UNKNOWNS]) {
    for (size_t i = 0; i < UNKNOWNS; i++) {
        side[i] = sums->of[i][REST];
        for (size_t j = 0; j < UNKNOWNS; j++) {
            side[i] += precision[i * UNKNOWNS + j] * (before[j] - x[j]);
            matrix[i * UNKNOWNS + j] = precision[i * UNKNOWNS + j] + sums->of[i > j ? i : j][i > j ? j : i];
        }
    }
}

bool likeliest_displacement(const ScanEvidence *evidence, const Registration *registration, bool is_iterated,
                            Room *room, double x[UNKNOWNS], double *covariance) {
    double precision[UNKNOWNS * UNKNOWNS], matrix[UNKNOWNS * UNKNOWNS], before[UNKNOWNS] = {0.0};
    if (!prior_precision(evidence, registration, precision))
        return false;
    memcpy(before, registration->estimate, DISPLACEMENTS * sizeof *before);
    memcpy(x, before, sizeof before);
    if (!is_iterated)
        memcpy(x, registration->applied, sizeof registration->applied);
    const int rounds = evidence->is_unknown ? 0 : is_iterated ? ROUNDS : 1;
    memcpy(matrix, precision, sizeof matrix);
    if (!linearise(evidence, registration->applied, registration->misfit, x, room))
        return false;
    for (int round = 0; round < rounds; round++) {
        double move[UNKNOWNS] = {0.0}, last[UNKNOWNS], largest = 0.0;
        NormalSums sums = {{{0.0}}};
        if (round > 0 && !linearise(evidence, registration->applied, registration->misfit, x, room))
            return false;
        for (int weighing = 0; weighing < REWEIGHTINGS; weighing++) {
            double side[UNKNOWNS];
            add_normal_equations(evidence, room, move, weighing > 0 ? last : NULL, round < ROUNDS_WITH_OUTLIERS, &sums);
            add_prior(precision, before, x, &sums, matrix, side);
            if (!solve_definite(UNKNOWNS, matrix, side))
                return false;
            memcpy(last, move, sizeof last);
            memcpy(move, side, sizeof move);
        }
        for (size_t k = 0; k < UNKNOWNS; k++) {
            largest = fmax(largest, fabs(move[k]));
            x[k] += move[k];
        }
        keep_within(x);
        if (largest < CONVERGED && round >= ROUNDS_WITH_OUTLIERS)
            break;
    }
    if (evidence->is_unknown)
        memcpy(x, before, sizeof before); /* nothing is learnt, nothing forgotten */
    return invert_definite(UNKNOWNS, matrix, covariance);
}
