/* The robust fit of a scan: ink, and where the sensor looks.
 *
 * Two models explain a scan by the same prediction: in register, or displaced by a geometry g. Both fit the shares of
 * the ink with errors of readings that have a t distribution about what sensor and droplets explain. The geometry shows
 * at walls, so only these enter its Gauss-Newton steps. A displacement is believed if the odds speak for it, and if it
 * explains: a true one leaves residuals of one to two variances; droplets of another kind leave ten and more whatever
 * is fitted. Until that is clear readings at walls are weak: by the covariance of the geometry and by its square. */
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

/* What a model makes of a scan. */
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

/* What the fit leaves of the datum at a cell [m]. */
static inline double datum_left(const InkFit *fit, size_t nx, size_t ny, size_t cell) {
    double row[ROW_TERMS];
    const double w = place_on(cell % ny, ny);
    datum_of_row(fit->datum, place_on(cell / ny, nx), row);
    return row[0] + w * (row[1] + w * row[2]);
}

/* What a change of the shares from those known before adds to a cell [m]. */
double share_change(const ScanEvidence *evidence, const double share[], size_t cell);

/* Whether a fit leaves more than droplets of the model's and the sensor explain. */
bool is_misfit(const InkFit *fit);

/* The scan in register. False if it cannot be solved for. */
bool fit_in_register(const ScanEvidence *evidence, FitRoom *room, InkFit *fit);

/* Marks the walls by squares of the slopes of the prediction, and fits the displaced scan: the registration after it,
 * and `displaced`. `in_register` is what it is compared with. False if there is no memory. */
bool fit_displaced(const ScanEvidence *evidence, const double *slopes, const InkFit *in_register, FitRoom *room,
                   Registration *registration, InkFit *displaced);

/* What displaced scans left unexplained in the last scans: whether a displacement may be the truth. */
bool may_be_displaced(const Registration *registration);

/* Variance of a reading through the geometry [m^2]: slopes along x and y, slope with the spread of the spot. */
double geometry_variance(const double *covariance, double along_x, double along_y, double with_spread, double u,
                         double w);

#endif
