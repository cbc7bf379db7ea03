/* Readings of the predicted surface by a displaced sensor with a wide spot. */
#include "scan_fit.h"

#include <math.h>
#include <string.h>

static const double POINT = 1e-9;        /* variance below which a spot is a point [cells^2] */
static const double NARROW = 0.36;       /* variance up to which a spot covers adjacent cells only [cells^2] */
static const double SPREAD_CHANGE = 0.1; /* step of a difference quotient [cells^2] */
/* reach of a spot in standard deviations: less than a ten-thousandth lies beyond */
static const double BORDER = 4.0;
enum { TAPS_MAX = 5 }; /* taps of a spot to each side */

/* Weights of the cells at distance 0, 1, ...; their variance is that of the spot. Returns the largest distance. */
static size_t spot_weights(double spread, double weights[TAPS_MAX + 1]) {
    double sum = 1.0;
    weights[0] = 1.0;
    if (spread < POINT)
        return 0;
    if (spread < NARROW) {
        weights[0] = 1.0 - spread;
        weights[1] = 0.5 * spread;
        return 1;
    }
    for (size_t k = 1; k <= TAPS_MAX; k++) {
        weights[k] = exp(-0.5 * (double)(k * k) / spread);
        sum += 2.0 * weights[k];
    }
    for (size_t k = 0; k <= TAPS_MAX; k++)
        weights[k] /= sum;
    return TAPS_MAX;
}

/* A map and its mean over a spot along one axis, with the weights of the cells at each distance. */
typedef struct {
    const ScanEvidence *evidence;
    const double *map;
    double *mean;
    bool is_along_x;
    size_t reach;
    double weights[TAPS_MAX + 1];
} SpotMean;

static void average_rows(void *context, const RowRange *range) {
    const SpotMean of = *(const SpotMean *)context;
    const size_t ny = of.evidence->ny, last = (of.is_along_x ? of.evidence->nx : ny) - 1;
    const size_t step = of.is_along_x ? ny : 1;
    for (size_t i = range->top; i < range->bottom; i++)
        for (size_t j = 0; j < ny; j++) {
            const double *here = of.map + i * ny + j;
            const size_t at = of.is_along_x ? i : j;
            double sum = of.weights[0] * *here;
            for (size_t k = 1; k <= of.reach; k++) {
                const size_t back = k < at ? k : at, on = k < last - at ? k : last - at;
                sum += of.weights[k] * (*(here - back * step) + here[on * step]);
            }
            of.mean[i * ny + j] = sum;
        }
}

/* The map averaged over a spot; scratch in the first of the lists. */
static void average_over_spot(const ScanEvidence *evidence, const double *map, double spread, double *averaged) {
    SpotMean of = {.evidence = evidence, .map = map, .mean = evidence->lists[0]};
    of.reach = spot_weights(spread, of.weights);
    over_rows(evidence, average_rows, &of);
    of.map = of.mean;
    of.mean = averaged;
    of.is_along_x = true;
    over_rows(evidence, average_rows, &of);
}

/* The prediction with other shares. */
typedef struct {
    const ScanEvidence *evidence;
    const double *share;
    double *predicted;
} SharePrediction;

static void predict_rows(void *context, const RowRange *range) {
    const SharePrediction *of = context;
    for (size_t cell = range->top * of->evidence->ny; cell < range->bottom * of->evidence->ny; cell++)
        of->predicted[cell] = of->evidence->predicted[cell] + share_change(of->evidence, of->share, cell);
}

static void take_spread_slope(void *context, const RowRange *range) {
    const ScanEvidence *evidence = context;
    double *slope = evidence->spread_slope;
    for (size_t cell = range->top * evidence->ny; cell < range->bottom * evidence->ny; cell++)
        slope[cell] = (slope[cell] - evidence->averaged[cell]) / SPREAD_CHANGE;
}

void average_prediction(const ScanEvidence *evidence, const double share[], double spread) {
    double *predicted = evidence->lists[1];
    over_rows(evidence, predict_rows, &(SharePrediction){evidence, share, predicted});
    average_over_spot(evidence, predicted, spread, evidence->averaged);
    average_over_spot(evidence, predicted, fmax(spread, 0.0) + SPREAD_CHANGE, evidence->spread_slope);
    over_rows(evidence, take_spread_slope, evidence);
}

/* A map and its readings. */
typedef struct {
    const ScanEvidence *evidence;
    const double *map;
    double *reading;
} MapReadings;

static void read_rows(void *context, const RowRange *range) {
    const MapReadings *of = context;
    const size_t nx = of->evidence->nx, ny = of->evidence->ny;
    for (size_t i = range->top; i < range->bottom; i++)
        for (size_t j = 0; j < ny; j++) {
            const Spot spot = spot_of(of->evidence->known->registration.estimate, nx, ny, i, j);
            const Place place = place_of(nx, ny, spot.x, spot.y);
            of->reading[i * ny + j] = value_at(of->map, &place);
        }
}

const double *read_map(const ScanEvidence *evidence, const double *map, double *reading) {
    const Registration *registration = &evidence->known->registration;
    if (!registration->is_displaced)
        return map;
    average_over_spot(evidence, map, registration->estimate[SPREAD], evidence->lists[1]);
    over_rows(evidence, read_rows, &(MapReadings){evidence, evidence->lists[1], reading});
    return reading;
}

/* Variance of a reading whose spot extends beyond the grid [m^2]: the surface there may continue level, as
 * average_over_spot assumes, or not count. */
static double border_variance(const ScanEvidence *evidence, const Reading *reading, double spread) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    const Spot *spot = &reading->spot;
    const double to[4] = {spot->x, (double)nx - 1.0 - spot->x, spot->y, (double)ny - 1.0 - spot->y};
    double sum = 0.0;
    if (spread < POINT)
        return 0.0;
    for (size_t side = 0; side < 4; side++) {
        if (!(to[side] < BORDER * sqrt(spread)))
            continue;
        const double x[4] = {0.0, (double)nx, spot->x, spot->x}, y[4] = {spot->y, spot->y, 0.0, (double)ny};
        const Place border = place_of(nx, ny, x[side], y[side]);
        /* share of the spot beyond the border */
        const double share = 0.5 * erfc((fmax(to[side], 0.0) + 0.5) / sqrt(2.0 * spread));
        const double off = share / (1.0 - share) * (reading->value - value_at(evidence->predicted, &border));
        sum += off * off;
    }
    return sum;
}

double sensor_variance(const ScanEvidence *evidence, const Reading *reading, double spread, double averaged) {
    const double x = reading->slopes.along_x, y = reading->slopes.along_y;
    const double shape = SHAPE_ERROR * spread * reading->slopes.with_spread;
    const double view = PLACE_ERROR * PLACE_ERROR * (x * x + y * y) + shape * shape;
    return evidence->noise_variance + view + border_variance(evidence, reading, averaged);
}

double geometry_variance(const double *covariance, const Slopes *slopes, double u, double w) {
    double column[GEOMETRY], sum = 0.0;
    geometry_column(slopes, u, w, column);
    for (size_t a = 0; a < GEOMETRY; a++) {
        double line = 0.5 * covariance[a * GEOMETRY + a] * column[a];
        for (size_t b = 0; b < a; b++)
            line += covariance[a * GEOMETRY + b] * column[b];
        sum += 2.0 * line * column[a];
    }
    return sum;
}

void reversed(const double g[GEOMETRY], size_t nx, size_t ny, double back[GEOMETRY]) {
    const double rise = half_of(nx), run = half_of(ny);
    const double a = 1.0 + g[ALONG_X_U] / rise, b = g[ALONG_X_W] / run, c = g[ALONG_Y_U] / rise,
                 d = 1.0 + g[ALONG_Y_W] / run, determinant = a * d - b * c;
    memset(back, 0, GEOMETRY * sizeof *back);
    if (!(fabs(determinant) > 0.1))
        return;
    const double inverse[4] = {d / determinant, -b / determinant, -c / determinant, a / determinant};
    back[SHIFT_X] = -(inverse[0] * g[SHIFT_X] + inverse[1] * g[SHIFT_Y]);
    back[SHIFT_Y] = -(inverse[2] * g[SHIFT_X] + inverse[3] * g[SHIFT_Y]);
    back[ALONG_X_U] = (inverse[0] - 1.0) * rise;
    back[ALONG_X_W] = inverse[1] * run;
    back[ALONG_Y_U] = inverse[2] * rise;
    back[ALONG_Y_W] = (inverse[3] - 1.0) * run;
}
