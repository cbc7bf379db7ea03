/* The robust fit of a scan in register: ink, and what is left of the datum.
 *
 * Errors of readings have a t distribution about what sensor and droplets explain. The fit of a displaced scan
 * (displaced_fit.h) explains it by the same prediction, and uses the equations of this one where there are no walls. */
#ifndef INKLOOP_SCAN_FIT_H
#define INKLOOP_SCAN_FIT_H

#include "scan_view.h"

/* A scan and what was known before it; maps of nx * ny cells in C order. */
typedef struct {
    const EstimatorOptions *options;
    const Knowledge *known;
    const JettedLayer *layer;
    const double *scan; /* without its datum, 0 where it is not valid [m] */
    const uint8_t *valid;
    const double *before, *predicted;    /* heights, by the ink known before [m] */
    const double *variance;              /* of the heights before [m^2] */
    const DropletIncrements *increments; /* of the layer */
    double noise_variance;               /* of a reading [m^2] */
    double droplet_variance;             /* of a droplet's volume [1] */
    const ScanDatum *datum;              /* that was taken off */
} ScanEvidence;

enum { OWN, SPILL, CLASSES }; /* cells with a droplet; others that droplets reach */

/* Result of a fit of a scan. */
typedef struct {
    double share[SHARES_MAX], covariance[SHARES_MAX * SHARES_MAX];
    double datum[DATUM_TERMS]; /* what is left of that of the scan [m] */
    double datum_covariance[DATUM_TERMS * DATUM_TERMS];
    double misfit[CLASSES];          /* median square of what is left, in variances of droplets and sensor [1] */
    double mean_base, mean_droplets; /* over cells with a droplet: variances without it, and of it [m^2] */
    size_t droplets;                 /* their number */
} InkFit;

/* Maps that a fit needs: `spread_slope` and `averaged` are of the prediction, for what follows it. */
typedef struct {
    double *averaged, *spread_slope, *lists[2];
    uint8_t *walls, *marks; /* walls: cells that a displacement may move beyond droplets and sensor; marks: a map */
} FitRoom;

/* Squares of the slopes [m^2 per cell^2]. */
void slope_squares(size_t nx, size_t ny, const double *height, double *squares);

/* Variance that droplets and sensor give to the reading of a cell [m^2]. */
static inline double native_variance(const ScanEvidence *evidence, size_t cell) {
    return evidence->noise_variance + evidence->variance[cell] +
           evidence->droplet_variance * evidence->increments->squares[cell];
}

/* Column of a share: what its change adds to the cells. */
typedef struct {
    const double *map;
    double factor;
} ShareColumn;
ShareColumn share_column(const ScanEvidence *evidence, size_t share);

/* Remainder of the datum at a cell, by the fit [m]. */
static inline double datum_left(const InkFit *fit, size_t nx, size_t ny, size_t cell) {
    double row[ROW_TERMS];
    const double w = place_on(cell % ny, ny);
    datum_of_row(fit->datum, place_on(cell / ny, nx), row);
    return row[0] + w * (row[1] + w * row[2]);
}

/* Height that a change of the shares from those known before adds to a cell [m]. */
double share_change(const ScanEvidence *evidence, const double share[], size_t cell);

/* Whether a fit leaves more than droplets of the model's and the sensor explain. */
bool is_misfit(const InkFit *fit);

/* The scan in register. False if it cannot be solved for. */
bool fit_in_register(const ScanEvidence *evidence, FitRoom *room, InkFit *fit);

/* Parts that both fits share. */

static const double NU = 4.0;               /* degrees of freedom of a reading's error (Lange, Little, Taylor 1989) */
static const double MEDIAN_SQUARE = 0.4549; /* of a normal variable of variance 1 */
enum { LEAST_READINGS = 12, SMOOTH_MAX = DATUM_TERMS + SHARES_MAX };

/* Weight of a reading whose error has a t distribution. */
static inline double weight_of(double rest, double variance) {
    return (NU + 1.0) / (NU * variance + rest * rest);
}

/* Residual of a reading, by the ink known before [m]. */
static inline double plain_rest(const ScanEvidence *evidence, size_t cell) {
    return evidence->scan[cell] - evidence->predicted[cell];
}

/* Number of shares that are learnt. */
static inline size_t learnt_shares(const EstimatorOptions *options) {
    return options->ink.model == INK_OFF ? 0 : ink_shares(&options->ink);
}

/* Whether so many variances are more than droplets of the model's and the sensor explain. */
bool is_foreign(double misfit);

/* A share within the limits of what is believed. */
double share_within(double share);

/* The normal equations of what moves readings without geometry: terms of the datum, and changes of the shares. */
typedef struct {
    double matrix[SMOOTH_MAX * SMOOTH_MAX], side[SMOOTH_MAX];
} SmoothSums;

/* Of the cells that are not left out. misfit: of the classes, by which their variances are larger than those of
 * droplets and sensor; NULL: they are not. */
SmoothSums smooth_sums(const ScanEvidence *evidence, size_t shares, const uint8_t *left_out, const double *misfit);

/* Prior precision of datum and shares, in rows of `stride`. False if it is not definite. */
bool smooth_prior(const ScanEvidence *evidence, size_t shares, size_t stride, double *precision);

/* Takes datum and shares into the fit, from `first` on among `all` unknowns. */
void take_smooth(const double *x, const double *covariance, size_t first, size_t shares, size_t all, InkFit *fit);

#endif
