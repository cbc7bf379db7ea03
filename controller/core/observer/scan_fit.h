/* A scan with what was known before it, and what any fit of it gives: ink, what is left of the datum, and misfits. */
#ifndef INKLOOP_SCAN_FIT_H
#define INKLOOP_SCAN_FIT_H

#include "row_ranges.h"
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

/* Height that a change of the shares from those known before adds to a cell [m]. */
double share_change(const ScanEvidence *evidence, const double share[], size_t cell);

/* The prediction with such shares, averaged over a spot, with its slope by it: both into the room. */
void average_prediction(const ScanEvidence *evidence, const double share[], double spread, FitRoom *room);

/* Number of shares that are learnt. */
static inline size_t learnt_shares(const EstimatorOptions *options) {
    return options->ink.model == INK_OFF ? 0 : ink_shares(&options->ink);
}

/* Whether so many variances are more than droplets of the model's and the sensor explain. */
bool is_foreign(double misfit);

/* Whether a fit leaves more than droplets of the model's and the sensor explain. */
bool is_misfit(const InkFit *fit);

/* Fewer readings have no median that tells. */
enum { LEAST_READINGS = 12 };

/* Cells of a row that are worked on at a time; their places, from `column` on. */
enum { BLOCK = 64 };
static INLINED void places_in_row(size_t ny, size_t column, size_t count, double *w) {
    const double step = ny > 1 ? 2.0 / ((double)ny - 1.0) : 0.0;
    for (size_t k = 0; k < count; k++)
        w[k] = step > 0.0 ? step * (double)(int32_t)(column + k) - 1.0 : 0.0;
}

/* Misfits of datum and shares of a fit in register, as medians, with its means over droplets. */
void take_misfits(const ScanEvidence *evidence, FitRoom *room, InkFit *fit);

#endif
