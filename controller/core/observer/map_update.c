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

enum { ROW_VARIANCE = 5 };

static double process_variance(const MapUpdate *update, size_t cell) {
    const ScanEvidence *evidence = update->evidence;
    const double squares = evidence->increments.squares[cell];
    const double droplets = evidence->droplet_variance * squares;
    const double extra = squares > 0.0 ? update->extra[class_of(evidence, cell)] : 0.0;
    const double variance = evidence->variance[cell] + droplets + extra * native_variance(evidence, cell);
    return variance > LEAST_VARIANCE ? variance : LEAST_VARIANCE;
}

/* Variances of a reading's error, the larger the more it surprises, and of the jump of its cell [m^2]. */
typedef struct {
    double error, jump;
} Belief;

/* error: variance of a reading that does not surprise; known: that of the prediction [m^2]. */
static Belief believe(const MapUpdate *update, size_t cell, double rest, double error, double known, CellSums *sums) {
    const SurfaceEstimate *before = update->evidence->before, *after = update->evidence->after;
    const double square = rest * rest / (known + error), earlier = before->surprise[cell];
    double weight = 1.0;
    if (square > 0.5 * SURPRISE * SURPRISE)
        weight = 1.0 / (1.0 + exp(fmin(0.5 * (square - SURPRISE * SURPRISE), 60.0)));
    const bool is_big = weight < CERTAIN, has_surprised = earlier != 0.0;
    const bool is_same = is_big && earlier * rest > 0.0 && fabs(earlier) > SAME * fabs(rest);
    const bool is_back = is_big && earlier * rest < 0.0 && fabs(rest) > SAME * fabs(earlier);
    const uint8_t times = is_same ? before->surprised[cell] + 1 : is_big ? 1 : 0;
    const bool is_real = is_same && times >= (before->known->vanishing > SPIKY ? 3 : 2);
    sums->count[SEEN]++;
    /* within one standard deviation: a smaller rest may be what neighbours' droplets left of a change that lasts */
    sums->count[VANISHED] += has_surprised && (update->is_robust ? square < 1.0 : is_back);
    const bool is_failed = update->evidence->living.pattern[cell] > 0 && earlier < 0.0; /* a droplet failed */
    sums->count[LASTED] += has_surprised && !is_failed && (update->is_robust ? is_same : !is_big);
    after->surprise[cell] = is_big && !is_real ? rest : 0.0;
    after->surprised[cell] = is_real ? 0 : times;
    const bool is_believed = is_big && (is_real || !update->is_robust);
    const double counted = is_believed || !update->is_robust ? 1.0 : fmax(weight, LEAST_WEIGHT);
    return (Belief){error / counted + known * (1.0 / counted - 1.0), is_believed ? rest * rest : 0.0};
}

/* Clears the surprises of a cell that was not seen. */
static void clear_surprise(const MapUpdate *update, size_t cell) {
    update->evidence->after->surprise[cell] = 0.0;
    update->evidence->after->surprised[cell] = 0;
}

/* Updates the evidence that a cell is dead; returns whether this layer shows no growth there. */
static bool take_dead(const MapUpdate *update, size_t cell, bool is_seen, double rest, double variance) {
    const double earlier = update->evidence->before->dead_evidence[cell], own = update->evidence->full_own[cell];
    update->evidence->after->dead_evidence[cell] = earlier;
    if (!is_seen || !(own > 0.0) || update->evidence->is_unknown)
        return false;
    const double grown = rest + (earlier < DEAD_EVIDENCE ? update->evidence->increments.own[cell] : 0.0);
    const double weak = DEAD_WEAK * own;
    const double evidence = weak * (0.5 * weak - grown) / fmax(fmin(variance, own * own), LEAST_VARIANCE);
    const double sum = earlier + fmin(LAYER_EVIDENCE, fmax(-LAYER_EVIDENCE, evidence));
    update->evidence->after->dead_evidence[cell] = fmin(DEAD_EVIDENCE, fmax(0.0, sum));
    return evidence > 0.0;
}

/* Restores the evidence of dead cells where most of the part did not grow: the ink has run out, no nozzle is to
 * blame. */
static void forget_dry(const ScanEvidence *evidence, size_t dry) {
    if ((double)dry > WHOLE_HEAD * (double)evidence->part)
        memcpy(evidence->after->dead_evidence, evidence->before->dead_evidence, evidence->cells * sizeof(double));
}

/* Coefficients of the powers of w: variance of a reading in the row at u by the residual datum [m^2]. */
static void row_variance(const MapUpdate *update, double u, double row[ROW_VARIANCE]) {
    static const size_t POWER[DATUM_TERMS] = {0, 0, 1, 0, 1, 2};
    const double factor[DATUM_TERMS] = {1.0, u, 1.0, u * u, u, 1.0};
    memset(row, 0, ROW_VARIANCE * sizeof *row);
    for (size_t i = 0; i < DATUM_TERMS; i++)
        for (size_t j = 0; j < DATUM_TERMS; j++)
            row[POWER[i] + POWER[j]] += factor[i] * update->fit->datum_covariance[i * DATUM_TERMS + j] * factor[j];
}

static double datum_variance(const double row[ROW_VARIANCE], double w) {
    return row[0] + w * (row[1] + w * (row[2] + w * (row[3] + w * row[4])));
}

static void update_rows(void *context, const RowRange *range) {
    const MapUpdate *update = context;
    const ScanEvidence *evidence = update->evidence;
    const SurfaceEstimate *before = evidence->before, *after = evidence->after;
    const size_t nx = evidence->nx, ny = evidence->ny;
    const double *predicted = evidence->predicted;
    CellSums sums = {.count = {0}};
    for (size_t i = range->top; i < range->bottom; i++) {
        double row[ROW_VARIANCE];
        row_variance(update, place_on(i, nx), row);
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            const double expected = predicted[cell] + share_change(evidence, update->fit->share, cell);
            double spread = process_variance(update, cell), rest = 0.0, gain = 0.0, variance = 1.0;
            after->unseen[cell] = evidence->valid[cell] ? 0 : before->unseen[cell] + 1;
            if (evidence->valid[cell]) {
                const double u = place_on(i, nx), w = place_on(j, ny);
                rest = evidence->scan[cell] - datum_at(update->fit->datum, u, w) - expected;
                double error = evidence->noise_variance + datum_variance(row, w);
                if (update->geometry && evidence->walls[cell]) {
                    const double up = predicted[i > 0 ? cell - ny : cell],
                                 down = predicted[i + 1 < nx ? cell + ny : cell];
                    const double left = predicted[j > 0 ? cell - 1 : cell];
                    const double right = predicted[j + 1 < ny ? cell + 1 : cell];
                    const Slopes slopes = {0.5 * (down - up), 0.5 * (right - left), evidence->spread_slope[cell]};
                    error += geometry_variance(update->geometry, &slopes, u, w);
                }
                variance = spread + error;
                const Belief belief = believe(update, cell, rest, error, spread, &sums);
                spread += belief.jump;
                gain = spread / (spread + belief.error);
            } else
                clear_surprise(update, cell);
            sums.count[DRY] += take_dead(update, cell, evidence->valid[cell], rest, variance);
            after->height[cell] = expected + gain * rest;
            after->variance[cell] = (1.0 - gain) * spread;
        }
    }
    evidence->sums[range->chunk] = sums;
}

CellSums update_in_register(const MapUpdate *update) {
    const CellSums sums = over_rows(update->evidence, update_rows, update);
    forget_dry(update->evidence, sums.count[DRY]);
    return sums;
}

/* Variances and changes of the prediction, in the maps of variances and heights. */
static void predict_rows(void *context, const RowRange *range) {
    const MapUpdate *update = context;
    const ScanEvidence *evidence = update->evidence;
    for (size_t cell = range->top * evidence->ny; cell < range->bottom * evidence->ny; cell++) {
        evidence->after->variance[cell] = process_variance(update, cell);
        evidence->after->height[cell] = share_change(evidence, update->fit->share, cell);
    }
}

/* Maps of the readings of a displaced scan: their weights, their weighted residuals, and the jumps of cells. */
static void look_at_readings(void *context, const RowRange *range) {
    const MapUpdate *update = context;
    const ScanEvidence *evidence = update->evidence;
    const size_t nx = evidence->nx, ny = evidence->ny;
    const double *g = evidence->after->known->registration.estimate;
    double *weight = evidence->slopes, *off = evidence->lists[0], *jump = evidence->lists[1];
    CellSums sums = {.count = {0}};
    for (size_t i = range->top; i < range->bottom; i++) {
        double row[ROW_VARIANCE];
        row_variance(update, place_on(i, nx), row);
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
            const double known = value_at(evidence->after->variance, &reading.place);
            const double rest = evidence->scan[cell] - datum_at(update->fit->datum, u, w) - reading.value;
            const double error = sensor_variance(evidence, &reading, g[SPREAD], g[SPREAD]) + datum_variance(row, w) +
                                 geometry_variance(update->geometry, &reading.slopes, u, w);
            const Belief belief = believe(update, cell, rest, error, known, &sums);
            weight[cell] = 1.0 / belief.error;
            off[cell] = rest / belief.error;
            jump[cell] = belief.jump;
        }
    }
    evidence->sums[range->chunk] = sums;
}

static void update_displaced_rows(void *context, const RowRange *range) {
    const MapUpdate *update = context;
    const ScanEvidence *evidence = update->evidence;
    const SurfaceEstimate *before = evidence->before, *after = evidence->after;
    const size_t nx = evidence->nx, ny = evidence->ny;
    const double *weight = evidence->slopes, *off = evidence->lists[0], *jump = evidence->lists[1];
    size_t dry = 0;
    for (size_t i = range->top; i < range->bottom; i++)
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            const Spot spot = spot_of(update->back, nx, ny, i, j);
            const Place place = place_of(nx, ny, spot.x, spot.y);
            const size_t nearest = place.cell + (place.x > 0.5 ? place.below : 0) + (place.y > 0.5 ? place.right : 0);
            const bool is_read = weight[nearest] > 0.0;
            const double seen = value_at(weight, &place);
            const double spread = after->variance[cell], known = spread + jump[nearest];
            const double rest = seen * known > NOT_SEEN ? value_at(off, &place) / seen : 0.0;
            const double gain = known * seen / (1.0 + known * seen);
            const double own = is_read ? off[nearest] / weight[nearest] : 0.0;
            dry += take_dead(update, cell, is_read, own, spread + evidence->noise_variance);
            after->unseen[cell] = is_read ? 0 : before->unseen[cell] + 1;
            after->height[cell] = evidence->predicted[cell] + after->height[cell] + gain * rest;
            after->variance[cell] = (1.0 - gain) * known;
        }
    evidence->sums[range->chunk].count[DRY] = dry;
}

CellSums update_displaced(MapUpdate *update) {
    const ScanEvidence *evidence = update->evidence;
    over_rows(evidence, predict_rows, update);
    const CellSums sums = over_rows(evidence, look_at_readings, update);
    reversed(evidence->after->known->registration.estimate, evidence->nx, evidence->ny, update->back);
    forget_dry(evidence, over_rows(evidence, update_displaced_rows, update).count[DRY]);
    return sums;
}

void live_on_prediction(const ScanEvidence *evidence) {
    ScanEvidence unread = *evidence;
    InkFit known = {.droplets = 0};
    memcpy(known.share, evidence->known->share, sizeof known.share);
    unread.valid = memset(evidence->marks, 0, evidence->cells);
    update_in_register(&(MapUpdate){.evidence = &unread, .fit = &known});
}
