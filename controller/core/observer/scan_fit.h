/* A scan with the prior knowledge, and the result of any fit of it: ink, residual datum, and misfits. */
#ifndef INKLOOP_SCAN_FIT_H
#define INKLOOP_SCAN_FIT_H

#include "row_ranges.h"
#include "scan_view.h"

/* A scan and the prior knowledge; maps of nx * ny cells in C order. */
typedef struct {
    const EstimatorOptions *options;
    const Knowledge *known;
    const JettedLayer *layer;
    const double *scan; /* scan without its datum, 0 where it is not valid [m] */
    const uint8_t *valid;
    /* heights before and after the layer, predicted with the ink known before [m] */
    const double *before, *predicted;
    const double *variance;              /* variance of the predicted heights before the scan [m^2] */
    const DropletIncrements *increments; /* increments of the layer */
    double noise_variance;               /* variance of a reading [m^2] */
    double droplet_variance;             /* variance of a droplet's volume [1] */
    double printed[INKS_MAX];            /* cells with a droplet of each ink in the layer, as a share of the part */
    const ScanDatum *datum;              /* datum that was subtracted */
} ScanEvidence;

enum { OWN, SPILL, CLASSES }; /* cells with a droplet; others that droplets reach */

/* Result of a fit of a scan. */
typedef struct {
    double share[SHARES_MAX], covariance[SHARES_MAX * SHARES_MAX];
    double datum[DATUM_TERMS]; /* correction of the datum [m] */
    double datum_covariance[DATUM_TERMS * DATUM_TERMS];
    double misfit[CLASSES]; /* median squared residual, in variances of droplets and sensor [1] */
    /* means over cells with a droplet: variance without that of droplets, and of droplets [m^2] */
    double mean_base, mean_droplets;
    size_t droplets; /* number of cells with a droplet */
} InkFit;

/* Maps of a fit; `spread_slope` and `averaged` belong to the prediction and are used after the fit. */
typedef struct {
    double *averaged, *spread_slope, *lists[2];
    /* walls: cells that a displacement may move beyond the variance of droplets and sensor; marks: a map */
    uint8_t *walls, *marks;
} FitRoom;

/* Squares of the slopes of a map [m^2 per cell^2]. */
void slope_squares(size_t nx, size_t ny, const double *height, double *squares);

/* Variance of a cell's reading by droplets and sensor [m^2]. */
static inline double native_variance(const ScanEvidence *evidence, size_t cell) {
    return evidence->noise_variance + evidence->variance[cell] +
           evidence->droplet_variance * evidence->increments->squares[cell];
}

/* Column of a share in the normal equations: height per change of the share. */
typedef struct {
    const double *map;
    double factor;
} ShareColumn;
ShareColumn share_column(const ScanEvidence *evidence, size_t share);

/* Height added to a cell by a change of the shares from those known before [m]. */
double share_change(const ScanEvidence *evidence, const double share[], size_t cell);

/* The prediction with these shares, averaged over a spot, and its derivative with respect to the spot: both into the
 * room. */
void average_prediction(const ScanEvidence *evidence, const double share[], double spread, FitRoom *room);

/* Number of shares that are fitted. */
static inline size_t learnt_shares(const EstimatorOptions *options) {
    return options->ink.model == INK_OFF ? 0 : ink_shares(&options->ink);
}

/* Whether so many variances are more than sensor and model's droplets explain. */
bool is_foreign(double misfit);

/* Whether a fit leaves more than sensor and model's droplets explain. */
bool is_misfit(const InkFit *fit);

/* Least number of readings for a median. */
enum { LEAST_READINGS = 12 };

/* Cells of a row that are processed together; their places, from `column` on. */
enum { BLOCK = 64 };
static INLINED void places_in_row(size_t ny, size_t column, size_t count, double *w) {
    const double step = ny > 1 ? 2.0 / ((double)ny - 1.0) : 0.0;
    for (size_t k = 0; k < count; k++)
        w[k] = step > 0.0 ? step * (double)(int32_t)(column + k) - 1.0 : 0.0;
}

/* Medians of the squared residuals of a fit in register, and its means over droplets. */
void take_misfits(const ScanEvidence *evidence, FitRoom *room, InkFit *fit);

#endif
