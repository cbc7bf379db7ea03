/* The robust fit of a displaced scan: ink, datum, and geometry.
 *
 * The geometry shows at walls, so only these enter its Gauss-Newton steps. A displacement is believed if the odds
 * favour it and its residuals are small: a true one leaves one to two variances; droplets that the model does not
 * describe leave ten and more in any fit. Until this is decided readings at walls are down-weighted by the covariance
 * and the square of the geometry. */
#include "scan_fit.h"

#include <math.h>
#include <string.h>

#include "map_memory.h"
#include "small_algebra.h"

/* step per scan of the linear part, at the edge [1], and of the spot [cells^2] (assumed) */
static const double LINEAR_STEP = 5e-4, SPREAD_STEP = 0.01;
/* least step of the shift [cells]; gain of its learning */
static const double LEAST_STEP = 0.01, STEP_GAIN = 0.3;
static const double LONGEST_MOVE = 0.7;   /* longest Gauss-Newton step [cells] */
static const double LARGEST_SPREAD = 4.0; /* largest variance of a spot [cells^2] */
/* change of the shares of the ink below which the averaged prediction is kept, under a spot of one cell */
static const double SAME_SHARE = 1e-3;
/* change of the spot [cells^2] within which readings are linear in it */
static const double SAME_SPREAD = 0.02;
static const double TEMPER = 0.5; /* tempering of the likelihood, as errors of neighbours are correlated (assumed) */
/* penalty per scan in log odds: the gain of seven unknowns by chance, 7/2, tempered */
static const double PRICE = 1.75;
static const double LEAST_ODDS = -6.0, LARGEST_ODDS = 40.0, DECIDED = 3.0;
/* standard deviations from which a shift stands out of foreign droplets (assumed) */
static const double STANDS_OUT = 5.0;
/* least half step of the difference quotients [cells]; their factor per round: there is no gradient beyond an edge */
static const double SHORT_STEP = 0.05, SHORTER = 0.7;
static const double CONVERGED = 1e-3; /* Gauss-Newton step that ends the iteration [cells, cells^2] */
/* standard deviation of the shift above which whole cells are searched first [cells] */
static const double UNKNOWN_SHIFT = 0.3;
enum { SHIFTS_TRIED = 3, ROUNDS = 30, COLD_ROUNDS = 2 };
_Static_assert((int)FITTED <= (int)UNKNOWNS_MAX, "solved for together");

/* Averages the prediction with the ink of the unknowns over their spot. */
static void average_walls(const double *x, WallFit *fit) {
    fit->spread = fmax(x[SPREAD], 0.0);
    memcpy(fit->share, x + SHARE, sizeof fit->share);
    average_prediction(fit->evidence, fit->share, fit->spread);
}

/* Prior of the unknowns: geometry, datum, shares. `precision` and `side` have the normal equations of the cells that
 * are no walls, too, as in register: the surface is flat there. */
typedef struct {
    double before[FITTED], precision[FITTED * FITTED], side[FITTED], covariance[GEOMETRY * GEOMETRY];
} WallPrior;

/* Unknowns and covariance of the geometry before the scan. */
static void expect_geometry(const ScanEvidence *evidence, const Registration *registration, WallPrior *prior) {
    const double rise = LINEAR_STEP * half_of(evidence->nx), run = LINEAR_STEP * half_of(evidence->ny);
    const double steps[GEOMETRY] = {
        sqrt(registration->steps[0]), sqrt(registration->steps[1]), rise, run, rise, run, SPREAD_STEP};
    memcpy(prior->covariance, registration->covariance, sizeof prior->covariance);
    for (size_t k = 0; k < GEOMETRY; k++)
        prior->covariance[k * (GEOMETRY + 1)] += steps[k] * steps[k];
    memcpy(prior->before, registration->estimate, sizeof registration->estimate);
    memcpy(prior->before + SHARE, evidence->known->share, sizeof evidence->known->share);
}

/* The prior precision, and the equations of cells without walls, with variances by the fit in register. */
static bool expect_smooth(const WallFit *fit, const InkFit *in_register, WallPrior *prior) {
    const size_t all = SHARE + fit->evidence->shares;
    double geometry[GEOMETRY * GEOMETRY];
    if (!invert_definite(GEOMETRY, prior->covariance, geometry))
        return false;
    copy_block(GEOMETRY, geometry, GEOMETRY, prior->precision, all);
    return smooth_equations(fit->evidence, fit->evidence->walls, in_register, all, prior->precision + DATUM * (all + 1),
                            prior->side + DATUM);
}

/* The normal equations about x, with the prior; the matrix below the diagonal. */
static void equations_of_walls(const WallFit *fit, const WallPrior *prior, const double *x, double heat, double *matrix,
                               double *side) {
    const size_t all = SHARE + fit->evidence->shares;
    memcpy(matrix, prior->precision, all * all * sizeof *matrix);
    for (size_t a = 0; a < all; a++) {
        side[a] = prior->side[a];
        for (size_t b = 0; b < all; b++)
            side[a] += prior->precision[a * all + b] * (prior->before[b] - x[b]);
    }
    for (size_t k = 0; k < fit->count; k++) {
        const Wall *wall = &fit->walls[k];
        const double weight = (NU + 1.0) / (NU * (heat * wall->variance) + wall->rest * wall->rest);
        for (size_t a = 0; a < all; a++) {
            const double of = weight * wall->column[a];
            side[a] += of * wall->rest;
            for (size_t b = 0; b <= a; b++)
                matrix[a * all + b] += of * wall->column[b];
        }
    }
}

/* Whether readings are linear from the averaged prediction on: within small changes of spot and shares. */
static bool is_averaged(const WallFit *fit, const double *x) {
    double off = 0.0;
    for (size_t k = 0; k < fit->evidence->shares; k++)
        off = fmax(off, fabs(x[SHARE + k] - fit->share[k]));
    return fabs(x[SPREAD] - fit->spread) <= SAME_SPREAD && off * fmin(x[SPREAD], 1.0) <= SAME_SHARE;
}

static void keep_within(size_t shares, const double *before, double *x) {
    for (size_t k = 0; k < GEOMETRY; k++)
        x[k] = fmin(before[k] + LONGEST_MOVE, fmax(before[k] - LONGEST_MOVE, x[k]));
    x[SPREAD] = fmin(LARGEST_SPREAD, x[SPREAD]);
    for (size_t k = 0; k < shares; k++)
        x[SHARE + k] = share_within(x[SHARE + k]);
}

/* Cost of the readings by a geometry, with the prior. */
static double cost_of_walls(const WallPrior *prior, const double *x, WallFit *fit) {
    double cost = 0.0;
    look_at_walls(x, fit);
    for (size_t k = 0; k < fit->count; k++)
        cost += log1p(fit->walls[k].rest * fit->walls[k].rest / (NU * fit->walls[k].variance));
    cost *= 0.5 * (NU + 1.0);
    for (size_t k = SHIFT_X; k <= SHIFT_Y; k++) {
        const double off = x[k] - prior->before[k];
        cost += 0.5 * off * off / prior->covariance[k * GEOMETRY + k];
    }
    return cost;
}

/* The best shift by whole cells, where it is not known: Gauss-Newton steps find no minimum further away. */
static void begin_at_best(const WallPrior *prior, WallFit *fit, double *x) {
    double trial[FITTED], least = INFINITY;
    memcpy(trial, prior->before, sizeof trial);
    memcpy(x, prior->before, sizeof trial);
    if (fmax(prior->covariance[0], prior->covariance[GEOMETRY + 1]) < UNKNOWN_SHIFT * UNKNOWN_SHIFT)
        return;
    for (int i = -SHIFTS_TRIED; i <= SHIFTS_TRIED; i++)
        for (int j = -SHIFTS_TRIED; j <= SHIFTS_TRIED; j++) {
            trial[SHIFT_X] = prior->before[SHIFT_X] + (double)i;
            trial[SHIFT_Y] = prior->before[SHIFT_Y] + (double)j;
            const double cost = cost_of_walls(prior, trial, fit);
            if (cost < least) {
                least = cost;
                memcpy(x, trial, sizeof trial);
            }
        }
}

/* A spot of a variance below `least` is none: the other unknowns given that. Limiting it alone would leave ink and
 * walls where a sharper spot has them. */
static void leave_out_spot(double least, const double *covariance, size_t all, double *x) {
    const double *of = covariance + SPREAD * all, spread = x[SPREAD];
    for (size_t k = 0; k < all && spread < least; k++)
        x[k] -= of[k] / of[SPREAD] * spread;
}

/* Gauss-Newton steps from the prior mean; errors weigh less at first, so that a scan that has moved far does not count
 * as outliers. */
static bool solve_walls(const WallPrior *prior, WallFit *fit, double *x, double *covariance) {
    const size_t all = SHARE + fit->evidence->shares;
    double matrix[ENTRIES_MAX], side[UNKNOWNS_MAX];
    begin_at_best(prior, fit, x);
    for (int round = 0; round < ROUNDS; round++) {
        double before[FITTED];
        if (!is_averaged(fit, x))
            average_walls(x, fit);
        fit->step = fmax(SHORT_STEP, SLOPE_STEP * pow(SHORTER, (double)round));
        look_at_walls(x, fit);
        const double heat = round + COLD_ROUNDS < ROUNDS ? heat_of(fit, prior->covariance) : 1.0;
        equations_of_walls(fit, prior, x, heat, matrix, side);
        if (!invert_definite(all, matrix, covariance))
            return false;
        memcpy(before, x, all * sizeof *x);
        double largest = 0.0;
        for (size_t k = 0; k < all; k++)
            for (size_t l = 0; l < all; l++)
                x[k] += covariance[k * all + l] * side[l];
        leave_out_spot(0.0, covariance, all, x);
        keep_within(fit->evidence->shares, before, x);
        for (size_t k = 0; k < GEOMETRY; k++)
            largest = fmax(largest, fabs(x[k] - before[k]));
        if (heat == 1.0 && largest < CONVERGED)
            break;
    }
    look_at_walls(x, fit);
    equations_of_walls(fit, prior, x, 1.0, matrix, side);
    if (!invert_definite(all, matrix, covariance))
        return false;
    leave_out_spot(2.0 * sqrt(covariance[SPREAD * (all + 1)]), covariance, all, x);
    look_at_walls(x, fit);
    return true;
}

/* Whether a shift is neither chance, by the misfit of its fit, nor an error of the view. all: number of unknowns. */
static bool stands_out(const double *x, const double *covariance, size_t all, double misfit) {
    const double least = STANDS_OUT * STANDS_OUT * misfit, model = PLACE_ERROR * PLACE_ERROR;
    return x[SHIFT_X] * x[SHIFT_X] > least * (covariance[0] + model) ||
           x[SHIFT_Y] * x[SHIFT_Y] > least * (covariance[all + 1] + model);
}

/* all: number of unknowns. Foreign droplets look like a linear part or a spot, as they are alike at both ends of a
 * wall, but not like a shift: one that stands out of the first scans is believed alone where nothing explains them. A
 * displacement that explains the first scans and later ones not is none: droplets land off their cells. */
static void learn_geometry(const double *x, const double *covariance, size_t all, double misfit, double gained,
                           Registration *registration) {
    memmove(registration->misfits + 1, registration->misfits, (REMEMBERED - 1) * sizeof misfit);
    registration->misfits[0] = misfit;
    registration->fits++;
    registration->odds = fmin(LARGEST_ODDS, fmax(LEAST_ODDS, registration->odds + TEMPER * gained - PRICE));
    for (size_t k = 0; k < 2 && registration->fits > 1 && may_be_displaced(registration); k++) {
        const double step = x[k] - registration->estimate[k];
        registration->steps[k] =
            fmax((1.0 - STEP_GAIN) * registration->steps[k] + STEP_GAIN * step * step, LEAST_STEP * LEAST_STEP);
    }
    const bool is_all = may_be_displaced(registration), is_likely = registration->odds > DECIDED;
    if (is_likely && !is_all && registration->fits <= REMEMBERED && stands_out(x, covariance, all, misfit))
        registration->is_shifted = 1;
    registration->is_displaced = is_likely && (is_all || registration->is_shifted);
    memcpy(registration->estimate, x, sizeof registration->estimate);
    for (size_t k = ALONG_X_U; k < GEOMETRY && registration->is_displaced && !is_all; k++)
        registration->estimate[k] = 0.0;
    copy_block(GEOMETRY, covariance, all, registration->covariance, GEOMETRY);
}

bool fit_displaced(const ScanEvidence *evidence, const InkFit *in_register, Registration *registration,
                   InkFit *displaced) {
    const size_t all = SHARE + evidence->shares;
    WallFit *fit = take_raw_maps(1, sizeof *fit); /* too large for the stack of a small thread */
    WallPrior prior = {.side = {0.0}};
    double x[FITTED], covariance[ENTRIES_MAX];
    if (!fit)
        return false;
    fit->evidence = evidence;
    fit->step = SLOPE_STEP;
    *displaced = *in_register;
    displaced->droplets = 0;
    expect_geometry(evidence, registration, &prior);
    mark_walls(evidence, prior.covariance);
    collect_walls(fit);
    average_walls(prior.before, fit);
    if (fit->count >= LEAST_READINGS && expect_smooth(fit, in_register, &prior) &&
        solve_walls(&prior, fit, x, covariance)) {
        const double left = misfit_of(fit, displaced);
        take_smooth(evidence, x, covariance, all, displaced);
        const double gained = fmin(likelihood_gained(fit, in_register), likelihood_gained(fit, displaced));
        learn_geometry(x, covariance, all, left, gained, registration);
    }
    give_maps(fit);
    return true;
}
