#include "displaced_fit.h"

#include <math.h>
#include <string.h>

#include "map_memory.h"
#include "median.h"
#include "near_cells.h"
#include "small_algebra.h"

static const double WALL = 0.1;  /* of the variance of a droplet: the least that a displacement moves */
static const double STEEP = 0.8; /* layers per cell */
static const double LINEAR_STEP = 5e-4, SPREAD_STEP = 0.01; /* per scan, at the edge [1], [cells^2] (assumed) */
static const double LEAST_STEP = 0.01, STEP_GAIN = 0.3;     /* of the shift [cells]; of what is learnt of it */
static const double LONGEST_MOVE = 0.7;                     /* of a Gauss-Newton step [cells] */
static const double LARGEST_SPREAD = 4.0;                   /* [cells^2] */
static const double SAME_SHARE = 1e-3;                      /* of the ink, under a spot of a cell */
static const double SAME_SPREAD = 0.02;                     /* [cells^2] within which readings are linear in the spot */
static const double TEMPER = 0.5; /* of a likelihood: errors of neighbours go together (assumed) */
static const double PRICE = 1.75; /* per scan, in odds: what seven unknowns gain by chance, 7/2, tempered */
static const double LEAST_ODDS = -6.0, LARGEST_ODDS = 40.0, DECIDED = 3.0;
static const double SHORT_STEP = 0.05,
                    SHORTER = 0.7;            /* [cells]; times as long each round: beyond an edge nothing pulls */
static const double QUARTILE_SQUARE = 1.3233; /* of a normal variable of variance 1 */
static const double CONVERGED = 1e-3;         /* [cells, cells^2] */
static const double UNKNOWN_SHIFT = 0.3;      /* [cells], standard deviation from which on whole cells are tried */
enum {
    SHIFTS_TRIED = 3,
    ROUNDS = 30,
    COLD_ROUNDS = 2,
    WALLS_MAX = 640,
    DATUM = GEOMETRY,
    SHARE = DATUM + DATUM_TERMS,
    FITTED = SHARE + SHARES_MAX
};
_Static_assert((int)FITTED <= (int)UNKNOWNS_MAX, "solved for together");

double geometry_variance(const double *covariance, double along_x, double along_y, double with_spread, double u,
                         double w) {
    const double column[GEOMETRY] = {along_x, along_y, along_x * u, along_x * w, along_y * u, along_y * w, with_spread};
    double sum = 0.0;
    for (size_t a = 0; a < GEOMETRY; a++) {
        double line = 0.5 * covariance[a * GEOMETRY + a] * column[a];
        for (size_t b = 0; b < a; b++)
            line += covariance[a * GEOMETRY + b] * column[b];
        sum += 2.0 * line * column[a];
    }
    return sum;
}

bool may_be_displaced(const Registration *registration) {
    const double a = registration->misfits[0], b = registration->misfits[1], c = registration->misfits[2];
    const double middle = fmax(fmin(a, b), fmin(fmax(a, b), c));
    return !is_foreign(registration->fits == 1 ? a : registration->fits == 2 ? 0.5 * (a + b) : middle);
}

/* Covariance of the geometry before the scan. */
static void expected_covariance(const EstimatorOptions *options, const Registration *registration, double *covariance) {
    const double rise = fmax(0.5 * ((double)options->nx - 1.0), 0.5),
                 run = fmax(0.5 * ((double)options->ny - 1.0), 0.5);
    const double steps[GEOMETRY] = {sqrt(registration->steps[0]),
                                    sqrt(registration->steps[1]),
                                    LINEAR_STEP * rise,
                                    LINEAR_STEP * run,
                                    LINEAR_STEP * rise,
                                    LINEAR_STEP * run,
                                    SPREAD_STEP};
    memcpy(covariance, registration->covariance, GEOMETRY * GEOMETRY * sizeof *covariance);
    for (size_t k = 0; k < GEOMETRY; k++)
        covariance[k * GEOMETRY + k] += steps[k] * steps[k];
}

/* Marks the cells that the geometry may move: those near steep ones. */
static void mark_walls(const ScanEvidence *evidence, const double *slopes, const double *covariance, FitRoom *room) {
    const size_t nx = evidence->options->nx, ny = evidence->options->ny, cells = nx * ny;
    const double at_x = covariance[0] + covariance[ALONG_X_U * (GEOMETRY + 1)] + covariance[ALONG_X_W * (GEOMETRY + 1)];
    const double at_y =
        covariance[GEOMETRY + 1] + covariance[ALONG_Y_U * (GEOMETRY + 1)] + covariance[ALONG_Y_W * (GEOMETRY + 1)];
    const double spread = fmax(at_x, at_y), h1 = evidence->options->ink.nominal[0].h1;
    const double least = WALL * (evidence->noise_variance + evidence->droplet_variance * h1 * h1) / spread;
    const size_t reach = spread > 0.25 ? 3 : spread > 0.06 ? 2 : 1;
    for (size_t cell = 0; cell < cells; cell++)
        room->walls[cell] = slopes[cell] > least;
    for (size_t k = 0; k < reach; k++) {
        memcpy(room->marks, room->walls, cells);
        for (size_t i = 0; i < nx; i++)
            mark_near_row(room->marks, nx, ny, i, room->walls + i * ny);
    }
}

/* A reading at a wall, and how it goes with the unknowns: geometry, offset of the datum, shares. */
typedef struct {
    size_t cell;
    double u, w, column[FITTED], rest, variance, slopes;
    double alone, squares; /* variance and that of its droplets where no neighbours have the same error */
    size_t class;
} Wall;

typedef struct {
    const ScanEvidence *evidence;
    const FitRoom *room;
    size_t shares, count;
    double spread, share[SHARES_MAX]; /* spot [cells^2] and ink that the averaged prediction has */
    double step;                      /* half a step of the difference quotients that slopes are [cells] */
    Wall *walls;
    double *values; /* for medians */
} WallFit;

/* The readings at walls, at even distances if there are many. */
static void collect_walls(WallFit *fit) {
    const EstimatorOptions *options = fit->evidence->options;
    const size_t nx = options->nx, ny = options->ny;
    size_t all = 0;
    for (int is_counted = 0; is_counted < 2; is_counted++) {
        const size_t distance = (all + WALLS_MAX - 1) / WALLS_MAX;
        size_t found = 0;
        for (size_t cell = 0; cell < nx * ny; cell++) {
            if (!fit->evidence->valid[cell] || !fit->room->walls[cell])
                continue;
            if (is_counted && found % distance == 0)
                fit->walls[fit->count++] =
                    (Wall){.cell = cell, .u = place_on(cell / ny, nx), .w = place_on(cell % ny, ny)};
            found++;
        }
        all = found;
    }
}

/* Looks at the readings by the unknowns. */
static void look_at_walls(const double *x, WallFit *fit) {
    const ScanEvidence *evidence = fit->evidence;
    const size_t nx = evidence->options->nx, ny = evidence->options->ny;
    const double *averaged = fit->room->averaged, energy = spot_energy(fit->spread);
    for (size_t k = 0; k < fit->count; k++) {
        Wall *wall = &fit->walls[k];
        const Spot spot = spot_of(x, (double)(wall->cell / ny), (double)(wall->cell % ny), wall->u, wall->w);
        const Place place = place_of(nx, ny, spot.x, spot.y);
        const Place up = place_of(nx, ny, spot.x - fit->step, spot.y),
                    left = place_of(nx, ny, spot.x, spot.y - fit->step),
                    down = place_of(nx, ny, spot.x + fit->step, spot.y),
                    right = place_of(nx, ny, spot.x, spot.y + fit->step);
        const double along_x = (value_at(averaged, &down) - value_at(averaged, &up)) / (2.0 * fit->step);
        const double along_y = (value_at(averaged, &right) - value_at(averaged, &left)) / (2.0 * fit->step);
        const double with_spread = value_at(fit->room->spread_slope, &place);
        const double column[GEOMETRY] = {along_x,           along_y,           along_x * wall->u, along_x * wall->w,
                                         along_y * wall->u, along_y * wall->w, with_spread};
        const int32_t *pattern = evidence->layer->pattern + place.cell;
        const bool is_own = (pattern[0] > 0 && place.x < 1.0 && place.y < 1.0) ||
                            (pattern[place.below] > 0 && place.x > 0.0 && place.y < 1.0) ||
                            (pattern[place.right] > 0 && place.x < 1.0 && place.y > 0.0) ||
                            (pattern[place.below + place.right] > 0 && place.x > 0.0 && place.y > 0.0);
        wall->squares = energy * variance_at(evidence->increments->squares, &place);
        memcpy(wall->column, column, sizeof column);
        datum_terms(wall->u, wall->w, wall->column + DATUM);
        wall->slopes = along_x * along_x + along_y * along_y;
        wall->rest = evidence->scan[wall->cell] - value_at(averaged, &place) - (x[SPREAD] - fit->spread) * with_spread;
        for (size_t k = 0; k < DATUM_TERMS; k++)
            wall->rest -= x[DATUM + k] * wall->column[DATUM + k];
        const double view =
            evidence->noise_variance + view_variance(along_x, along_y, with_spread, x[SPREAD]) +
            border_variance(nx, ny, evidence->predicted, value_at(averaged, &place), &spot, fit->spread);
        wall->alone =
            view + energy * variance_at(evidence->variance, &place) + evidence->droplet_variance * wall->squares;
        wall->variance = view + value_at(evidence->variance, &place) +
                         evidence->droplet_variance * value_at(evidence->increments->squares, &place);
        wall->class = is_own ? OWN : wall->squares > 0.0 ? SPILL : CLASSES;
        for (size_t s = 0; s < fit->shares; s++) {
            const ShareColumn of = share_column(evidence, s);
            wall->column[SHARE + s] = of.factor * value_at(of.map, &place);
            wall->rest -= (x[SHARE + s] - fit->share[s]) * wall->column[SHARE + s];
        }
    }
}

/* Median error of steep readings in variances, at least 1: a fit far from its end gives them less weight. */
static double heat_of(const WallFit *fit, const double *covariance) {
    const double shift = fmax(covariance[0], covariance[GEOMETRY + 1]);
    size_t count = 0;
    for (size_t k = 0; k < fit->count; k++) {
        const Wall *wall = &fit->walls[k];
        if (wall->slopes * shift > 4.0 * wall->variance)
            fit->values[count++] = wall->rest * wall->rest / wall->variance;
    }
    return count > LEAST_READINGS / 2 ? fmax(1.0, median(fit->values, count) / MEDIAN_SQUARE) : 1.0;
}

/* Prior of the unknowns: geometry, datum, shares. */
typedef struct {
    double before[FITTED], precision[FITTED * FITTED], covariance[GEOMETRY * GEOMETRY];
    SmoothSums elsewhere; /* by the cells that are no walls, as if in register: there it is flat */
} WallPrior;

static bool prior_of_walls(const WallFit *fit, const Registration *registration, const double *misfit,
                           WallPrior *prior) {
    const ScanEvidence *evidence = fit->evidence;
    const size_t all = SHARE + fit->shares;
    double geometry[GEOMETRY * GEOMETRY];
    memset(prior, 0, sizeof *prior);
    expected_covariance(evidence->options, registration, prior->covariance);
    if (!invert_definite(GEOMETRY, prior->covariance, geometry) ||
        !smooth_prior(evidence, fit->shares, all, prior->precision + DATUM * (all + 1)))
        return false;
    for (size_t a = 0; a < GEOMETRY; a++)
        for (size_t b = 0; b < GEOMETRY; b++)
            prior->precision[a * all + b] = geometry[a * GEOMETRY + b];
    memcpy(prior->before, registration->estimate, sizeof registration->estimate);
    memcpy(prior->before + SHARE, evidence->known->share, fit->shares * sizeof(double));
    prior->elsewhere = smooth_sums(evidence, fit->shares, fit->room->walls, misfit);
    return true;
}

/* The equations of datum and shares by the cells that are no walls. */
static void add_elsewhere(const WallPrior *prior, const double *x, size_t shares, double *matrix, double *side) {
    const size_t n = DATUM_TERMS + shares, all = GEOMETRY + n;
    for (size_t a = 0; a < n; a++) {
        side[DATUM + a] += prior->elsewhere.side[a];
        for (size_t b = 0; b < n; b++) {
            side[DATUM + a] -= prior->elsewhere.matrix[a * n + b] * (x[DATUM + b] - prior->before[DATUM + b]);
            matrix[(DATUM + a) * all + DATUM + b] += prior->elsewhere.matrix[a * n + b];
        }
    }
}

/* The normal equations about x, with what is known before. */
static void equations_of_walls(const WallFit *fit, const WallPrior *prior, const double *x, double heat, double *matrix,
                               double *side) {
    const size_t all = SHARE + fit->shares;
    memcpy(matrix, prior->precision, all * all * sizeof *matrix);
    for (size_t a = 0; a < all; a++) {
        side[a] = 0.0;
        for (size_t b = 0; b < all; b++)
            side[a] += prior->precision[a * all + b] * (prior->before[b] - x[b]);
    }
    add_elsewhere(prior, x, fit->shares, matrix, side);
    for (size_t k = 0; k < fit->count; k++) {
        const Wall *wall = &fit->walls[k];
        const double weight = weight_of(wall->rest, heat * wall->variance);
        for (size_t a = 0; a < all; a++) {
            const double of = weight * wall->column[a];
            side[a] += of * wall->rest;
            for (size_t b = 0; b <= a; b++)
                matrix[a * all + b] += of * wall->column[b];
        }
    }
    for (size_t a = 0; a < all; a++)
        for (size_t b = a + 1; b < all; b++)
            matrix[a * all + b] = matrix[b * all + a];
}

/* The prediction with other ink, under a spot: x is the fit so far. */
static void average_prediction(const double *x, WallFit *fit) {
    const ScanEvidence *evidence = fit->evidence;
    const size_t nx = evidence->options->nx, ny = evidence->options->ny;
    double *predicted = fit->room->lists[1];
    fit->spread = fmax(x[SPREAD], 0.0);
    memcpy(fit->share, x + SHARE, fit->shares * sizeof *x);
    for (size_t cell = 0; cell < nx * ny; cell++)
        predicted[cell] =
            evidence->predicted[cell] + (fit->shares > 0 ? share_change(evidence, fit->share, cell) : 0.0);
    means_over_spot(nx, ny, predicted, fit->spread, fit->room->lists[0], fit->room->averaged);
    slope_with_spot(nx, ny, predicted, fit->room->averaged, fit->spread, fit->room->lists[0], fit->room->spread_slope);
}

/* Whether readings are linear from the averaged prediction on: what ink changes is not averaged. */
static bool is_averaged(const WallFit *fit, const double *x) {
    double off = 0.0;
    for (size_t k = 0; k < fit->shares; k++)
        off = fmax(off, fabs(x[SHARE + k] - fit->share[k]));
    return fabs(x[SPREAD] - fit->spread) <= SAME_SPREAD && off * fmin(x[SPREAD], 1.0) <= SAME_SHARE;
}

static void keep_within(size_t shares, const double *before, double *x) {
    for (size_t k = 0; k < GEOMETRY; k++)
        x[k] = fmin(before[k] + LONGEST_MOVE, fmax(before[k] - LONGEST_MOVE, x[k]));
    x[SPREAD] = fmin(LARGEST_SPREAD, fmax(0.0, x[SPREAD]));
    for (size_t k = 0; k < shares; k++)
        x[SHARE + k] = share_within(x[SHARE + k]);
}

/* Cost of the readings by a geometry, with what was known before: minus the logarithm of the likelihood. */
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

/* Tries shifts about x at such distances, `times` to each side; the best stays in x. */
static void try_shifts(const WallPrior *prior, int times, double distance, WallFit *fit, double *x) {
    const double at[2] = {x[SHIFT_X], x[SHIFT_Y]};
    double trial[FITTED], least = cost_of_walls(prior, x, fit);
    memcpy(trial, x, sizeof trial);
    for (int i = -times; i <= times; i++)
        for (int j = -times; j <= times; j++) {
            trial[SHIFT_X] = at[0] + distance * (double)i;
            trial[SHIFT_Y] = at[1] + distance * (double)j;
            const double cost = cost_of_walls(prior, trial, fit);
            if (cost < least) {
                least = cost;
                memcpy(x, trial, sizeof trial);
            }
        }
}

/* The best shift by whole cells, then by half ones, where it is not known: a step finds no minimum further away. */
static void begin_at_best(const WallPrior *prior, bool is_known, WallFit *fit, double *x) {
    const double spread = fmax(prior->covariance[0], prior->covariance[GEOMETRY + 1]);
    if (spread < UNKNOWN_SHIFT * UNKNOWN_SHIFT)
        return;
    try_shifts(prior, SHIFTS_TRIED, 1.0, fit, x);
    if (is_known || x[SHIFT_X] != prior->before[SHIFT_X] || x[SHIFT_Y] != prior->before[SHIFT_Y])
        try_shifts(prior, 1, 0.5, fit, x);
}

/* Gauss-Newton steps from what was known; hot at first, so that a scan that has moved far does not count as outliers.
 */
static bool solve_walls(const WallPrior *prior, bool is_known, WallFit *fit, double *x, double *covariance) {
    const size_t all = SHARE + fit->shares;
    double matrix[ENTRIES_MAX], side[UNKNOWNS_MAX];
    memset(x, 0, FITTED * sizeof *x);
    memcpy(x, prior->before, all * sizeof *x);
    begin_at_best(prior, is_known, fit, x);
    for (int round = 0; round < ROUNDS; round++) {
        double before[FITTED];
        if (!is_averaged(fit, x))
            average_prediction(x, fit);
        fit->step = fmax(SHORT_STEP, SLOPE_STEP * pow(SHORTER, (double)round));
        look_at_walls(x, fit);
        const double heat = round + COLD_ROUNDS < ROUNDS ? heat_of(fit, prior->covariance) : 1.0;
        equations_of_walls(fit, prior, x, heat, matrix, side);
        if (!solve_definite(all, matrix, side))
            return false;
        memcpy(before, x, all * sizeof *x);
        double largest = 0.0;
        for (size_t k = 0; k < all; k++)
            x[k] += side[k];
        keep_within(fit->shares, before, x);
        for (size_t k = 0; k < GEOMETRY; k++)
            largest = fmax(largest, fabs(x[k] - before[k]));
        if (heat == 1.0 && largest < CONVERGED)
            break;
    }
    look_at_walls(x, fit);
    equations_of_walls(fit, prior, x, 1.0, matrix, side);
    return invert_definite(all, matrix, covariance);
}

/* Groups of walls: by their class, steep ones, and even ones with a droplet of their own. */
enum { ALL_STEEP = CLASSES, EVEN_OWN, GROUPS };

static bool is_in_group(const Wall *wall, size_t group, double steep) {
    if (group < CLASSES)
        return wall->class == group;
    return (wall->slopes > steep) == (group == ALL_STEEP) && (group == ALL_STEEP || wall->class == OWN);
}

/* Residuals at walls, in variances, the largest of a group: the median, and half the upper quartile while scans are not
 * displaced, since droplets of another kind often leave half of the walls alone. Droplets are learnt from even cells:
 * on steep ones what the view does not model hides them. */
static double misfit_of(const WallFit *fit, bool is_displaced, InkFit *displaced) {
    const double layer = layer_of(fit->evidence->options), steep = STEEP * STEEP * layer * layer;
    double largest = 1.0;
    for (size_t group = 0; group < GROUPS; group++) {
        size_t count = 0;
        double squares = 0.0, variance = 0.0;
        for (size_t k = 0; k < fit->count; k++) {
            const Wall *wall = &fit->walls[k];
            if (!is_in_group(wall, group, steep))
                continue;
            fit->values[count++] = wall->rest * wall->rest / (group == EVEN_OWN ? wall->alone : wall->variance);
            squares += wall->squares;
            variance += wall->alone;
        }
        const bool is_many = count >= LEAST_READINGS;
        const double high = is_many ? upper_quartile(fit->values, count) / QUARTILE_SQUARE : 1.0;
        const double found = is_many ? median(fit->values, count) / MEDIAN_SQUARE : 1.0;
        if (group < EVEN_OWN)
            largest = fmax(largest, fmax(found, is_displaced ? 0.0 : 0.5 * high));
        if (group < CLASSES)
            displaced->misfit[group] = found;
        if (group < EVEN_OWN || count < LEAST_READINGS)
            continue;
        displaced->misfit[OWN] = found;
        displaced->droplets = count;
        displaced->mean_droplets = squares / (double)count;
        displaced->mean_base = variance / (double)count - fit->evidence->droplet_variance * displaced->mean_droplets;
    }
    return largest;
}

/* By how much likelier the readings are displaced than in register, with its datum and shares by one of the fits, as a
 * logarithm. */
static double likelihood_gained(const WallFit *fit, const InkFit *in_register) {
    const ScanEvidence *evidence = fit->evidence;
    const size_t nx = evidence->options->nx, ny = evidence->options->ny;
    double gained = 0.0;
    for (size_t k = 0; k < fit->count; k++) {
        const Wall *wall = &fit->walls[k];
        const double plain = plain_rest(evidence, wall->cell) - share_change(evidence, in_register->share, wall->cell) -
                             datum_left(in_register, nx, ny, wall->cell);
        const double variance = NU * fmin(wall->variance, native_variance(evidence, wall->cell));
        gained += log1p(plain * plain / variance) - log1p(wall->rest * wall->rest / variance);
    }
    return 0.5 * (NU + 1.0) * gained;
}

static void learn(const WallFit *fit, const double *x, const double *covariance, double misfit, double gained,
                  Registration *registration) {
    const size_t all = SHARE + fit->shares;
    if (registration->fits >= REMEMBERED)
        memmove(registration->misfits, registration->misfits + 1, (REMEMBERED - 1) * sizeof misfit);
    registration->misfits[registration->fits < REMEMBERED ? registration->fits : REMEMBERED - 1] = misfit;
    registration->fits++;
    registration->odds = fmin(LARGEST_ODDS, fmax(LEAST_ODDS, registration->odds + TEMPER * gained - PRICE));
    for (size_t k = 0; k < 2 && registration->fits > 1 && may_be_displaced(registration); k++) {
        const double step = x[k] - registration->estimate[k];
        registration->steps[k] =
            fmax((1.0 - STEP_GAIN) * registration->steps[k] + STEP_GAIN * step * step, LEAST_STEP * LEAST_STEP);
    }
    registration->is_displaced = registration->odds > DECIDED && may_be_displaced(registration);
    memcpy(registration->estimate, x, sizeof registration->estimate);
    for (size_t a = 0; a < GEOMETRY; a++)
        for (size_t b = 0; b < GEOMETRY; b++)
            registration->covariance[a * GEOMETRY + b] = covariance[a * all + b];
}

bool fit_displaced(const ScanEvidence *evidence, const double *slopes, const InkFit *in_register, FitRoom *room,
                   Registration *registration, InkFit *displaced) {
    const size_t n = learnt_shares(evidence->options), all = SHARE + n,
                 cells = evidence->options->nx * evidence->options->ny;
    WallFit fit = {.evidence = evidence, .room = room, .shares = n, .spread = -1.0, .step = SLOPE_STEP};
    WallPrior prior;
    double x[FITTED], covariance[ENTRIES_MAX];
    const double *misfit = is_misfit(in_register) ? in_register->misfit : NULL;
    *displaced = *in_register;
    displaced->droplets = 0;
    expected_covariance(evidence->options, registration, prior.covariance);
    if (registration->is_displaced)
        memset(room->walls, 1, cells);
    else
        mark_walls(evidence, slopes, prior.covariance, room);
    fit.walls = take_raw_maps(cells < WALLS_MAX ? cells : WALLS_MAX, sizeof(Wall) + sizeof(double));
    if (!fit.walls)
        return false;
    fit.values = (double *)(fit.walls + (cells < WALLS_MAX ? cells : WALLS_MAX));
    collect_walls(&fit);
    double start[FITTED] = {0.0};
    memcpy(start, registration->estimate, sizeof registration->estimate);
    memcpy(start + SHARE, evidence->known->share, n * sizeof *start);
    average_prediction(start, &fit);
    if (fit.count >= LEAST_READINGS && prior_of_walls(&fit, registration, misfit, &prior) &&
        solve_walls(&prior, registration->is_displaced, &fit, x, covariance)) {
        const double left = misfit_of(&fit, registration->is_displaced, displaced);
        take_smooth(x, covariance, DATUM, n, all, displaced);
        const double gained = fmin(likelihood_gained(&fit, in_register), likelihood_gained(&fit, displaced));
        learn(&fit, x, covariance, left, gained, registration);
    }
    give_maps(fit.walls);
    return true;
}
