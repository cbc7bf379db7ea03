/* Readings at walls, which determine the geometry of a displaced scan, and their residuals.
 *
 * The unknowns are geometry, terms of the datum, and shares of the ink. */
#include "scan_fit.h"

#include <math.h>
#include <string.h>

#include "median.h"

static const double WALL = 0.1;  /* least variance by displacement that makes a wall, in that of droplet and sensor */
static const double STEEP = 0.8; /* least slope of a steep wall, in layers per cell */
/* log odds below which scans are surely in register: fewer walls show whether they move (assumed) */
static const double IN_REGISTER = -5.0;
enum { WALLS_WATCHED = 160 };

void mark_walls(const ScanEvidence *evidence, const double *covariance) {
    if (evidence->known->registration.is_displaced) {
        memset(evidence->walls, 1, evidence->cells);
        return;
    }
    const double at_x = covariance[0] + covariance[ALONG_X_U * (GEOMETRY + 1)] + covariance[ALONG_X_W * (GEOMETRY + 1)];
    const double at_y =
        covariance[GEOMETRY + 1] + covariance[ALONG_Y_U * (GEOMETRY + 1)] + covariance[ALONG_Y_W * (GEOMETRY + 1)];
    const double spread = fmax(at_x, at_y), h1 = evidence->options->ink.nominal[0].h1;
    const double least = WALL * (evidence->noise_variance + evidence->droplet_variance * h1 * h1) / spread;
    const size_t reach = spread > 0.25 ? 3 : spread > 0.06 ? 2 : 1;
    mark_slopes(evidence, least, false);
    for (size_t k = 0; k < reach; k++) {
        copy_in_threads(evidence->living.threads, evidence->marks, evidence->walls, evidence->cells);
        mark_near(evidence, evidence->marks, evidence->walls);
    }
}

/* Samples the walls at even distances, if there are many. */
void collect_walls(WallFit *fit) {
    const size_t nx = fit->evidence->nx, ny = fit->evidence->ny;
    const size_t limit = fit->evidence->known->registration.odds < IN_REGISTER ? WALLS_WATCHED : WALLS_MAX;
    size_t sample[WALLS_MAX];
    fit->count = sample_cells(fit->evidence, fit->evidence->valid, fit->evidence->walls, 1, limit, sample);
    for (size_t k = 0; k < fit->count; k++) {
        const size_t cell = sample[k];
        fit->walls[k] = (Wall){.cell = cell, .u = place_on(cell / ny, nx), .w = place_on(cell % ny, ny)};
    }
}

static void look_at_wall(const double *x, const WallFit *fit, Wall *wall) {
    const ScanEvidence *evidence = fit->evidence;
    const size_t nx = evidence->nx, ny = evidence->ny;
    const Spot spot = spot_of(x, nx, ny, wall->cell / ny, wall->cell % ny);
    const Reading reading = reading_at(nx, ny, evidence->averaged, evidence->spread_slope, spot, fit->step);
    const Slopes *slopes = &reading.slopes;
    geometry_column(slopes, wall->u, wall->w, wall->column);
    datum_terms(wall->u, wall->w, wall->column + DATUM);
    wall->slopes = slopes->along_x * slopes->along_x + slopes->along_y * slopes->along_y;
    wall->squares = value_at(evidence->increments.squares, &reading.place);
    wall->class = value_at(evidence->increments.own, &reading.place) > 0.0 ? OWN
                  : wall->squares > 0.0                                    ? SPILL
                                                                           : CLASSES;
    wall->variance = sensor_variance(evidence, &reading, x[SPREAD], fit->spread) +
                     value_at(evidence->variance, &reading.place) + evidence->droplet_variance * wall->squares;
    wall->rest = evidence->scan[wall->cell] - reading.value - (x[SPREAD] - fit->spread) * slopes->with_spread;
    for (size_t k = 0; k < DATUM_TERMS; k++)
        wall->rest -= x[DATUM + k] * wall->column[DATUM + k];
    for (size_t s = 0; s < evidence->shares; s++) {
        const ShareColumn of = share_column(evidence, s);
        wall->column[SHARE + s] = of.factor * value_at(of.map, &reading.place);
        wall->rest -= (x[SHARE + s] - fit->share[s]) * wall->column[SHARE + s];
    }
}

void look_at_walls(const double *x, WallFit *fit) {
    for (size_t k = 0; k < fit->count; k++)
        look_at_wall(x, fit, &fit->walls[k]);
}

double heat_of(WallFit *fit, const double *covariance) {
    const double shift = fmax(covariance[0], covariance[GEOMETRY + 1]);
    size_t count = 0;
    for (size_t k = 0; k < fit->count; k++) {
        const Wall *wall = &fit->walls[k];
        if (wall->slopes * shift > 4.0 * wall->variance)
            fit->values[count++] = wall->rest * wall->rest / wall->variance;
    }
    return count > LEAST_READINGS / 2 ? fmax(1.0, median(fit->values, count) / MEDIAN_SQUARE) : 1.0;
}

/* Groups of walls: by their class, and steep ones. */
enum { STEEP_WALLS = CLASSES, GROUPS };

/* Misfit: the median, and until scans count as displaced the larger of it and half the upper quartile, since droplets
 * unlike the model's often leave half of the walls unchanged. */
double misfit_of(WallFit *fit, InkFit *displaced) {
    const bool is_displaced = fit->evidence->known->registration.is_displaced;
    const double layer = layer_of(fit->evidence->options), steep = STEEP * STEEP * layer * layer;
    double largest = 1.0;
    for (size_t group = 0; group < GROUPS; group++) {
        size_t count = 0;
        double squares = 0.0, variance = 0.0;
        for (size_t k = 0; k < fit->count; k++) {
            const Wall *wall = &fit->walls[k];
            if (group == STEEP_WALLS ? wall->slopes <= steep : wall->class != group)
                continue;
            fit->values[count++] = wall->rest * wall->rest / wall->variance;
            squares += wall->squares;
            variance += wall->variance;
        }
        const bool is_many = count >= LEAST_READINGS;
        const double high = is_many ? upper_quartile(fit->values, count) / QUARTILE_SQUARE : 1.0;
        const double found = is_many ? median(fit->values, count) / MEDIAN_SQUARE : 1.0;
        largest = fmax(largest, fmax(found, is_displaced ? 0.0 : 0.5 * high));
        if (group < CLASSES)
            displaced->misfit[group] = found;
        if (group != OWN || !is_many)
            continue;
        displaced->scatter = variance_within(fit->values, count, found);
        displaced->droplets = count;
        displaced->mean_droplets = squares / (double)count;
        displaced->mean_base = variance / (double)count - fit->evidence->droplet_variance * displaced->mean_droplets;
    }
    return largest;
}

double likelihood_gained(const WallFit *fit, const InkFit *in_register) {
    const ScanEvidence *evidence = fit->evidence;
    double gained = 0.0;
    for (size_t k = 0; k < fit->count; k++) {
        const Wall *wall = &fit->walls[k];
        const double plain = evidence->scan[wall->cell] - evidence->predicted[wall->cell] -
                             share_change(evidence, in_register->share, wall->cell) -
                             datum_at(in_register->datum, wall->u, wall->w);
        const double variance = NU * fmin(wall->variance, native_variance(evidence, wall->cell));
        gained += log((variance + plain * plain) / (variance + wall->rest * wall->rest));
    }
    return 0.5 * (NU + 1.0) * gained;
}
