/* Update of the maps by a scan, cell by cell: heights, their variances, surprises, and evidence of dead cells.
 *
 * A reading is weighted by its variance against that of the prediction. A residual beyond droplets and sensor is a
 * surprise: the first time it counts as an error of the sensor and gets hardly any weight; if it repeats, it counts as
 * a change of the cell. The residuals of a displaced scan are interpolated at the place of each cell on the scan. */
#include "scan_fit.h"

#include <math.h>
#include <string.h>

/* residual in standard deviations at which sensor and cell are equally likely causes (assumed) */
static const double SURPRISE = 4.5;
static const double CERTAIN = 0.9; /* weight of a reading below which it surprises */
static const double SAME = 0.4;    /* share of a surprise that a second one must reach to count as the same */
/* share of vanishing surprises above which a surprise must come three times, not two */
static const double SPIKY = 0.008;
static const double LEAST_VARIANCE = 1e-21; /* [m^2] */
static const double LEAST_WEIGHT = 1e-9;
static const double DEAD_WEAK = 0.3; /* least volume of a droplet from a living nozzle, as a share (assumed) */
/* limit of one layer's evidence: a single failed droplet is no dead nozzle */
static const double LAYER_EVIDENCE = 5.0;
static const double WHOLE_HEAD = 0.5; /* share of the part without growth above which the ink has run out */
/* weight of readings times variance of the cell, below which the cell counts as not seen */
static const double NOT_SEEN = 1e-6;

static double process_variance(const MapUpdate *update, size_t cell) {
    const ScanEvidence *evidence = update->evidence;
    const double squares = evidence->increments.squares[cell];
    const double droplets = evidence->droplet_variance * squares;
    const double extra = evidence->living.pattern[cell] > 0 ? update->extra[OWN]
                         : squares > 0.0                    ? update->extra[SPILL]
                                                            : 0.0;
    const double variance = evidence->variance[cell] + droplets + extra * native_variance(evidence, cell);
    return variance > LEAST_VARIANCE ? variance : LEAST_VARIANCE;
}

/* Variances of a reading's error, the larger the more it surprises, and of the jump of its cell [m^2]. */
typedef struct {
    double error, jump;
} Belief;

/* error: variance of a reading that does not surprise; known: that of the prediction [m^2]. */
static Belief believe(const MapUpdate *update, size_t cell, double rest, double error, double known, Surprises *count) {
    const SurfaceEstimate *before = update->evidence->before, *after = update->after;
    const double square = rest * rest / (known + error), told = before->surprise[cell];
    double weight = 1.0;
    if (square > 0.5 * SURPRISE * SURPRISE)
        weight = 1.0 / (1.0 + exp(fmin(0.5 * (square - SURPRISE * SURPRISE), 60.0)));
    const bool is_big = weight < CERTAIN, has_surprised = told != 0.0;
    const bool is_same = is_big && told * rest > 0.0 && fabs(told) > SAME * fabs(rest);
    const bool is_back = is_big && told * rest < 0.0 && fabs(rest) > SAME * fabs(told);
    const uint8_t times = is_same ? before->surprised[cell] + 1 : is_big ? 1 : 0;
    const bool is_real = is_same && times >= (before->known->vanishing > SPIKY ? 3 : 2);
    count->seen++;
    /* within one standard deviation: a smaller rest may be what neighbours' droplets left of a change that lasts */
    count->vanished += has_surprised && (update->is_robust ? square < 1.0 : is_back);
    const bool is_failed = update->evidence->living.pattern[cell] > 0 && told < 0.0; /* a droplet failed */
    count->lasted += has_surprised && !is_failed && (update->is_robust ? is_same : !is_big);
    after->surprise[cell] = is_big && !is_real ? rest : 0.0;
    after->surprised[cell] = is_real ? 0 : times;
    const bool is_believed = is_big && (is_real || !update->is_robust);
    const double counted = is_believed || !update->is_robust ? 1.0 : fmax(weight, LEAST_WEIGHT);
    return (Belief){error / counted + known * (1.0 / counted - 1.0), is_believed ? rest * rest : 0.0};
}

/* Clears the surprises of a cell that was not seen. */
static void clear_surprise(const MapUpdate *update, size_t cell) {
    update->after->surprise[cell] = 0.0;
    update->after->surprised[cell] = 0;
}

/* Updates the evidence that a cell is dead; returns whether this layer shows no growth there. */
static bool take_dead(const MapUpdate *update, size_t cell, bool is_seen, double rest, double variance) {
    const double told = update->evidence->before->dead_evidence[cell], own = update->evidence->full_own[cell];
    update->after->dead_evidence[cell] = told;
    if (!is_seen || !(own > 0.0) || update->evidence->is_unknown)
        return false;
    const double grown = rest + (told < DEAD_EVIDENCE ? update->evidence->increments.own[cell] : 0.0);
    const double weak = DEAD_WEAK * own;
    const double evidence = weak * (0.5 * weak - grown) / fmax(fmin(variance, own * own), LEAST_VARIANCE);
    const double sum = told + fmin(LAYER_EVIDENCE, fmax(-LAYER_EVIDENCE, evidence));
    update->after->dead_evidence[cell] = fmin(DEAD_EVIDENCE, fmax(0.0, sum));
    return evidence > 0.0;
}

/* Restores the evidence of dead cells where most of the part did not grow: the ink has run out, no nozzle is to
 * blame. */
static void forget_dry(const MapUpdate *update, size_t dry) {
    const size_t part = count_marked(update->evidence->options->part, update->evidence->cells);
    if ((double)dry > WHOLE_HEAD * (double)part)
        memcpy(update->after->dead_evidence, update->evidence->before->dead_evidence,
               update->evidence->cells * sizeof(double));
}

/* Residual datum of the fit along a row, and its variance. */
typedef struct {
    double left[ROW_TERMS], variance[ROW_VARIANCE_TERMS];
} DatumRow;

static DatumRow datum_row(const MapUpdate *update, size_t i) {
    const double u = place_on(i, update->evidence->nx);
    DatumRow row;
    datum_of_row(update->fit->datum, u, row.left);
    datum_variance_of_row(update->fit->datum_covariance, u, row.variance);
    return row;
}

static double variance_of(const DatumRow *row, double w) {
    const double *of = row->variance;
    return of[0] + w * (of[1] + w * (of[2] + w * (of[3] + w * of[4])));
}

Surprises update_in_register(const MapUpdate *update) {
    const ScanEvidence *evidence = update->evidence;
    const SurfaceEstimate *before = evidence->before, *after = update->after;
    const size_t nx = evidence->nx, ny = evidence->ny;
    const double *predicted = evidence->predicted;
    Surprises count = {0, 0, 0};
    size_t dry = 0;
    for (size_t i = 0; i < nx; i++) {
        const DatumRow row = datum_row(update, i);
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            const double expected = predicted[cell] + share_change(evidence, update->fit->share, cell);
            double spread = process_variance(update, cell), rest = 0.0, gain = 0.0, variance = 1.0;
            after->unseen[cell] = evidence->valid[cell] ? 0 : before->unseen[cell] + 1;
            if (evidence->valid[cell]) {
                const double w = place_on(j, ny);
                rest = evidence->scan[cell] - datum_in_row(row.left, w) - expected;
                double error = evidence->noise_variance + variance_of(&row, w);
                if (update->geometry && evidence->walls[cell]) {
                    const double up = predicted[i > 0 ? cell - ny : cell],
                                 down = predicted[i + 1 < nx ? cell + ny : cell];
                    const double left = predicted[j > 0 ? cell - 1 : cell];
                    const double right = predicted[j + 1 < ny ? cell + 1 : cell];
                    const Slopes slopes = {0.5 * (down - up), 0.5 * (right - left), evidence->spread_slope[cell]};
                    error += geometry_variance(update->geometry, &slopes, place_on(i, nx), w);
                }
                variance = spread + error;
                const Belief belief = believe(update, cell, rest, error, spread, &count);
                spread += belief.jump;
                gain = spread / (spread + belief.error);
            } else
                clear_surprise(update, cell);
            dry += take_dead(update, cell, evidence->valid[cell], rest, variance);
            after->height[cell] = expected + gain * rest;
            after->variance[cell] = (1.0 - gain) * spread;
        }
    }
    forget_dry(update, dry);
    return count;
}

/* Weighted residuals of the readings, their weights, and the jumps of cells. */
static Surprises look_at_readings(const MapUpdate *update, const double g[GEOMETRY], const double *spread,
                                  double *weight, double *off, double *jump) {
    const ScanEvidence *evidence = update->evidence;
    const size_t nx = evidence->nx, ny = evidence->ny;
    Surprises count = {0, 0, 0};
    for (size_t i = 0; i < nx; i++) {
        const DatumRow row = datum_row(update, i);
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            const double u = place_on(i, nx), w = place_on(j, ny);
            weight[cell] = off[cell] = jump[cell] = 0.0;
            if (!evidence->valid[cell]) {
                clear_surprise(update, cell);
                continue;
            }
            const Spot spot = spot_of(g, nx, ny, i, j);
            const Reading reading = reading_at(nx, ny, evidence->averaged, evidence->spread_slope, spot, SLOPE_STEP);
            const double known = value_at(spread, &reading.place);
            const double rest = evidence->scan[cell] - datum_in_row(row.left, w) - reading.value;
            const double error = sensor_variance(evidence, &reading, g[SPREAD], g[SPREAD]) + variance_of(&row, w) +
                                 geometry_variance(update->geometry, &reading.slopes, u, w);
            const Belief belief = believe(update, cell, rest, error, known, &count);
            weight[cell] = 1.0 / belief.error;
            off[cell] = rest / belief.error;
            jump[cell] = belief.jump;
        }
    }
    return count;
}

Surprises update_displaced(const MapUpdate *update, const double g[GEOMETRY]) {
    const ScanEvidence *evidence = update->evidence;
    const SurfaceEstimate *before = evidence->before, *after = update->after;
    const size_t nx = evidence->nx, ny = evidence->ny;
    double *spread = after->variance, *changed = after->height, *weight = evidence->slopes, *off = evidence->lists[0],
           *jump = evidence->lists[1], back[GEOMETRY];
    size_t dry = 0;
    for (size_t cell = 0; cell < nx * ny; cell++) {
        spread[cell] = process_variance(update, cell);
        changed[cell] = share_change(evidence, update->fit->share, cell);
    }
    const Surprises count = look_at_readings(update, g, spread, weight, off, jump);
    reversed(g, nx, ny, back);
    for (size_t i = 0; i < nx; i++)
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            const Spot spot = spot_of(back, nx, ny, i, j);
            const Place place = place_of(nx, ny, spot.x, spot.y);
            const size_t nearest = place.cell + (place.x > 0.5 ? place.below : 0) + (place.y > 0.5 ? place.right : 0);
            const bool is_read = weight[nearest] > 0.0;
            const double seen = value_at(weight, &place), known = spread[cell] + jump[nearest];
            const double rest = seen * known > NOT_SEEN ? value_at(off, &place) / seen : 0.0;
            const double gain = known * seen / (1.0 + known * seen);
            dry += take_dead(update, cell, is_read, is_read ? off[nearest] / weight[nearest] : 0.0,
                             spread[cell] + evidence->noise_variance);
            after->unseen[cell] = is_read ? 0 : before->unseen[cell] + 1;
            after->height[cell] = evidence->predicted[cell] + changed[cell] + gain * rest;
            after->variance[cell] = (1.0 - gain) * known;
        }
    forget_dry(update, dry);
    return count;
}

void live_on_prediction(const MapUpdate *update) {
    const SurfaceEstimate *before = update->evidence->before, *after = update->after;
    for (size_t cell = 0; cell < update->evidence->cells; cell++) {
        after->height[cell] = update->evidence->predicted[cell];
        after->variance[cell] = process_variance(update, cell);
        after->unseen[cell] = before->unseen[cell] + 1;
        after->dead_evidence[cell] = before->dead_evidence[cell];
        clear_surprise(update, cell);
    }
}
