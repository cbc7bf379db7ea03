/* Tests for scans that do not show the print, and for cells that get no more ink.
 *
 * Away from steep slopes each scan is compared with the prediction. If it fits badly, it is compared with other
 * explanations: nothing grew, the last scan again, the scan mirrored or turned. An explanation that fits far better
 * gains evidence; such a scan changes no map. Two in a row stop the print.
 */
#include "scan_fit.h"

#include <math.h>
#include <string.h>

static const double STEEP = 0.8;      /* slope in layers per cell above which a displacement moves readings */
static const double SUSPICIOUS = 2.5; /* mean square residual that is examined, in that of droplets and sensor */
static const double OUTLIER = 100.0;  /* largest square of a single cell in it */
/* share of the cost as read that another explanation must stay below (assumed) */
static const double FAR_BETTER = 0.4;
/* the same for surfaces that did not grow: a share, and a multiple of the noise */
static const double STUCK = 0.05, STUCK_NOISE = 8.0;
static const double KEPT = 0.5; /* share of the evidence kept from scan to scan */
/* evidence that stops the print: two scans in a row have 1.5, of three the first and the last 1.25 */
static const double BELIEVED = 1.2;
static const double LEAST_SHARE = 0.05; /* least share of the part with droplets: fewer show nothing */
static const double VOLUME_STD = 0.05;  /* standard deviation below which a share of the ink is known (assumed) */
/* least variance about a datum in layers^2, so that the datum does not follow a part */
static const double SMOOTH = 2e-4;
static const double NOISY = 1e-16;              /* variance above which readings never repeat bit by bit [m^2]: 10 nm */
enum { LEAST_CELLS = 40, LEAST_DROPLETS = 20 }; /* readings; cells with a droplet: fewer may all be of dead nozzles */

/* The cell of the scan that a transform maps to a cell of the printer. */
static size_t transformed(size_t nx, size_t ny, size_t cell, int transform) {
    const size_t i = cell / ny, j = cell % ny, up = nx - 1 - i, left = ny - 1 - j;
    const size_t from[DOUBTS - DOUBT_MIRRORED_X][2] = {{up, j}, {i, left}, {up, left}, {j, i},
                                                       {j, up}, {left, i}, {left, up}};
    const size_t *place = from[transform - DOUBT_MIRRORED_X];
    return place[0] * ny + place[1];
}

/* An explanation of a scan, and the largest square of a residual that counts. */
typedef struct {
    const ScanEvidence *evidence;
    const double *scan, *expected;
    const uint8_t *valid;
    double most;
    ScanDatum datum;
} Explanation;

static void add_residuals(void *context, const RowRange *range) {
    const Explanation *of = context;
    const ScanEvidence *evidence = of->evidence;
    const size_t nx = evidence->nx, ny = evidence->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        CellSums sums = {.count = {0}};
        for (size_t i = chunk_row(nx, chunk); i < chunk_row(nx, chunk + 1); i++)
            for (size_t j = 0; j < ny; j++) {
                const size_t cell = i * ny + j;
                if (!of->valid[cell] || !evidence->walls[cell])
                    continue;
                const double rest =
                    of->scan[cell] - of->expected[cell] - datum_at(of->datum.term, place_on(i, nx), place_on(j, ny));
                sums.sum[0] += rest * rest < of->most ? rest * rest : of->most;
                sums.count[0]++;
            }
        evidence->sums[chunk] = sums;
    }
}

/* Robust mean square residual of the readings against `expected`, with the datum fitted; below 0: too few cells. */
static double cost_of(const ScanEvidence *evidence, const double *scan, const uint8_t *valid, const double *expected,
                      double most) {
    const double layer = layer_of(evidence->options), noise = fmax(evidence->usual_noise, SMOOTH * layer * layer);
    Explanation of = {evidence, scan, expected,
                      valid,    most, scan_datum(evidence, scan, valid, expected, evidence->ground, noise)};
    if (of.datum.noise.variance < 0.0) /* hardly any ground: cells without steep slopes */
        of.datum = scan_datum(evidence, scan, valid, expected, evidence->walls, noise);
    const CellSums sums = over_rows(evidence, add_residuals, &of);
    return sums.count[0] < LEAST_CELLS ? -1.0 : sums.sum[0] / (double)sums.count[0];
}

/* Variance of the shares, mean over them. */
static double variance_of_shares(const InkPrior *prior, const Knowledge *known) {
    const size_t n = ink_shares(prior);
    double variance = 0.0;
    for (size_t k = 0; k < n; k++)
        variance += known->share_covariance[k * n + k] / (double)n;
    return variance;
}

static void add_growth(void *context, const RowRange *range) {
    const ScanEvidence *evidence = context;
    const size_t nx = evidence->nx, ny = evidence->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        CellSums sums = {.count = {0}};
        for (size_t cell = chunk_row(nx, chunk) * ny; cell < chunk_row(nx, chunk + 1) * ny; cell++) {
            if (evidence->living.pattern[cell] <= 0)
                continue;
            const double grown = evidence->predicted[cell] - evidence->before->height[cell];
            sums.sum[0] += evidence->increments.own[cell] * evidence->increments.own[cell];
            sums.sum[1] += grown * grown;
            sums.count[0]++;
        }
        evidence->sums[chunk] = sums;
    }
}

/* Mean square residual that droplets and sensor explain: the noise, and in the part the variance of droplets and of
 * their mean volume [m^2]; jetted: number of cells with a droplet. */
static double native_square(const ScanEvidence *evidence, size_t *jetted) {
    const CellSums sums = over_rows(evidence, add_growth, evidence);
    const double droplets = (double)(*jetted = sums.count[0]);
    if (sums.count[0] == 0)
        return INFINITY;
    const double share = droplets / fmax((double)evidence->part, 1.0), of_own = sums.sum[0] / droplets;
    return evidence->usual_noise + evidence->droplet_variance * of_own * fmax(share, LEAST_SHARE) +
           variance_of_shares(&evidence->options->ink, evidence->known) * (sums.sum[1] / droplets) * share;
}

/* Costs of the other explanations; below 0 or infinite where one does not apply. expected: readings predicted; jetted:
 * number of cells with a droplet. */
static void take_costs(const ScanEvidence *evidence, const double *expected, double most, size_t jetted,
                       double cost[DOUBTS]) {
    const size_t nx = evidence->nx, ny = evidence->ny, cells = evidence->cells;
    double *other = evidence->lists[0];
    uint8_t *marks = evidence->marks;
    const double *past = read_map(evidence, evidence->before->height, evidence->spread_slope);
    cost[DOUBT_NO_GROWTH] = cost_of(evidence, evidence->measured, evidence->valid, past, most);
    for (size_t cell = 0; cell < cells; cell++)
        marks[cell] = evidence->valid[cell] && evidence->before->last_valid[cell];
    cost[DOUBT_SAME_SCAN] = cost_of(evidence, evidence->measured, marks, evidence->before->last, most);
    for (size_t cell = 0; cell < cells; cell++)
        other[cell] = evidence->before->last[cell] + expected[cell] - past[cell];
    if (cost[DOUBT_SAME_SCAN] >= FAR_BETTER * cost_of(evidence, evidence->measured, marks, other, most))
        cost[DOUBT_SAME_SCAN] = INFINITY; /* it grew as predicted: what is left was left in the last scan, too */
    if (jetted < LEAST_DROPLETS)
        cost[DOUBT_NO_GROWTH] = cost[DOUBT_SAME_SCAN] = INFINITY;
    for (int transform = DOUBT_MIRRORED_X; transform < DOUBTS; transform++) {
        cost[transform] = -1.0;
        if (transform >= DOUBT_TRANSPOSED && nx != ny)
            continue;
        for (size_t cell = 0; cell < cells; cell++) {
            const size_t from = transformed(nx, ny, cell, transform);
            other[cell] = evidence->measured[from];
            marks[cell] = evidence->valid[from];
        }
        cost[transform] = cost_of(evidence, other, marks, expected, most);
    }
}

static bool is_last_scan(const ScanEvidence *evidence) {
    for (size_t cell = 0; cell < evidence->cells; cell++)
        if (evidence->valid[cell] && evidence->before->last_valid[cell] &&
            evidence->measured[cell] != evidence->before->last[cell])
            return false;
    return evidence->usual_noise > NOISY;
}

static void stop_print(LoopTrust *trust, int64_t reason, int32_t layer, int transform, double figure) {
    trust->stop = reason;
    trust->stop_layer = layer;
    trust->transform = transform;
    trust->stop_figure = figure;
}

/* Stops the print if two scans in a row fit the same explanation. */
static void conclude(const ScanEvidence *evidence, const double cost[DOUBTS], double read, int best, bool is_stuck,
                     LoopTrust *trust) {
    const double stuck = trust->doubts[DOUBT_NO_GROWTH] + trust->doubts[DOUBT_SAME_SCAN];
    if (trust->stop != 0 || (is_stuck ? stuck : trust->doubts[best]) < BELIEVED)
        return;
    const bool has_changed = cost[DOUBT_SAME_SCAN] >= FAR_BETTER * read;
    const int64_t reason = !is_stuck                ? STOP_TURNED
                           : has_changed            ? STOP_LATE
                           : is_last_scan(evidence) ? STOP_SAME_SCAN
                                                    : STOP_NO_GROWTH;
    const double figure = sqrt(read / fmax(fmax(cost[best], evidence->usual_noise), NOISELESS));
    stop_print(trust, reason, evidence->number, is_stuck ? 0 : best, figure);
}

bool doubt_scan(const ScanEvidence *evidence, LoopTrust *trust) {
    const EstimatorOptions *options = evidence->options;
    const Registration *registration = &evidence->known->registration;
    size_t jetted;
    const double layer = layer_of(options), native = native_square(evidence, &jetted), most = OUTLIER * native;
    const double steep =
        fmin(STEEP * STEEP * layer * layer, native / fmax(registration->steps[0], registration->steps[1]));
    double cost[DOUBTS];
    for (int k = 0; k < DOUBTS; k++)
        trust->doubts[k] *= KEPT;
    if (isinf(native))
        return false;
    mark_slopes(evidence, steep, true);
    const double *expected = read_map(evidence, evidence->predicted, evidence->averaged);
    const double read = cost_of(evidence, evidence->measured, evidence->valid, expected, most);
    if (read <= SUSPICIOUS * native)
        return false;
    take_costs(evidence, expected, most, jetted, cost);
    int best = DOUBT_NO_GROWTH; /* which applies wherever the scan as read does */
    for (int k = best + 1; k < DOUBTS; k++)
        if (cost[k] >= 0.0 && cost[k] < cost[best])
            best = k;
    if (cost[best] >= FAR_BETTER * read)
        return false;
    const bool is_stuck = best == DOUBT_NO_GROWTH || best == DOUBT_SAME_SCAN;
    if (is_stuck && cost[best] >= STUCK * read + STUCK_NOISE * evidence->usual_noise)
        return false;
    trust->doubts[best] += 1.0;
    conclude(evidence, cost, read, best, is_stuck, trust);
    return true;
}

void doubt_volume(const EstimatorOptions *options, int32_t layer, Knowledge *known) {
    LoopTrust *trust = &known->trust;
    const double volume = learnt_volume(options, known), variance = variance_of_shares(&options->ink, known);
    const bool is_known = variance < VOLUME_STD * VOLUME_STD && options->ink.model == INK_SCALE;
    trust->volume_doubt *= KEPT;
    if (!is_known || (volume >= options->volume_least && volume <= options->volume_most))
        return;
    trust->volume_doubt += 1.0;
    if (trust->stop == 0 && trust->volume_doubt >= BELIEVED)
        stop_print(trust, STOP_VOLUME, layer, 0, volume);
}
