/* A scan with the prior knowledge, the steps of its use, and the results of its fits. Each step has a source of its
 * own. */
#ifndef INKLOOP_SCAN_FIT_H
#define INKLOOP_SCAN_FIT_H

#include "row_ranges.h"
#include "scan_view.h"

enum { CELL_COUNTS = 6, CELL_SUMS = 2 };

/* Counts and sums over the cells of some rows, and the largest values with the first cells that have them. */
typedef struct {
    size_t count[CELL_COUNTS];
    double sum[CELL_SUMS], largest[CELL_SUMS];
    size_t at[CELL_SUMS];
} CellSums;

/* A layer, its prediction, and its scan. */
typedef struct ScanEvidence {
    const EstimatorOptions *options;
    size_t nx, ny, cells;          /* of the grid */
    size_t part;                   /* number of the part's cells */
    const SurfaceEstimate *before; /* estimate before the layer */
    SurfaceEstimate *after;        /* estimate after it */
    const Knowledge *known;        /* knowledge before the scan */
    size_t shares;                 /* shares that are fitted */
    int32_t number;                /* of the layer */
    bool is_unknown;               /* the layer was abandoned at an unknown place */
    JettedLayer living;            /* without droplets from dead nozzles */
    DropletIncrements increments;  /* increments of its layer map */
    double *predicted, *variance;  /* heights predicted with the ink known before [m], and their variances [m^2] */
    double *factor;                /* volumes of living droplets */
    double *full_own;              /* height that each cell's droplet would leave on it, dead nozzles included [m] */
    double *slopes;                /* squared slopes of the prediction [m^2 per cell^2] */
    const double *measured;        /* readings, 0 where they are not valid [m] */
    const uint8_t *valid;
    size_t readings;          /* number of valid ones */
    double *scan;             /* readings without their datum, 0 where they are not valid [m] */
    uint8_t *ground;          /* cells that no droplet reaches */
    double noise_variance;    /* variance of a reading [m^2] */
    double usual_noise;       /* the same before this scan [m^2] */
    double droplet_variance;  /* variance of a droplet's volume [1] */
    double printed[INKS_MAX]; /* cells with a droplet of each ink in the layer, as a share of the part */
    ScanDatum datum;          /* datum that was subtracted */
    /* maps of a fit: the prediction averaged over the spot, its derivative with respect to the spot, and scratch */
    double *averaged, *spread_slope, *lists[2];
    uint8_t *walls; /* cells that a displacement may move beyond the variance of droplets and sensor */
    uint8_t *marks; /* two maps of scratch */
    CellSums *sums; /* of each chunk of rows: over_rows */
    void *memory;   /* memory of all maps, released by give_maps */
} ScanEvidence;

/* Calls `work` on all rows in the threads of the layer; returns the `sums` that it left of each chunk, or of the chunks
 * of a range in its first one, together. */
CellSums over_rows(const ScanEvidence *evidence, RowWork *work, const void *context);

/* Marks the cells of `from` and their neighbours in another map. */
void mark_near(const ScanEvidence *evidence, const uint8_t *from, uint8_t *near);

/* Marks as walls the cells whose squared slope is below a limit, or the others. */
void mark_slopes(const ScanEvidence *evidence, double limit, bool is_below);

/* Samples the cells that both maps mark, all if `other` is NULL, at even distances if there are more than `most`.
 * Returns how many were stored; none if there are fewer than `least`. */
size_t sample_cells(const ScanEvidence *evidence, const uint8_t *one, const uint8_t *other, size_t least, size_t most,
                    size_t *cells);

/* Variance of a cell's reading by droplets and sensor [m^2]. */
static inline double native_variance(const ScanEvidence *evidence, size_t cell) {
    return evidence->noise_variance + evidence->variance[cell] +
           evidence->droplet_variance * evidence->increments.squares[cell];
}

enum { OWN, SPILL, CLASSES }; /* cells with a droplet; others that droplets reach */

static inline size_t class_of(const ScanEvidence *evidence, size_t cell) {
    return evidence->living.pattern[cell] > 0 ? OWN : SPILL;
}

/* Whether a cell has a reading, and droplets reach it. */
static inline bool is_reached(const ScanEvidence *evidence, size_t cell) {
    return evidence->valid[cell] && evidence->increments.squares[cell] > 0.0;
}

/* Predicts the surface after the layer `living`. An unknown layer counts as half printed, with the variance of a
 * uniform distribution between nothing and all, and without droplets. False if there is no memory. */
bool predict_layer(ScanEvidence *evidence);

/* Column of a share in the normal equations: height per change of the share. */
typedef struct {
    const double *map;
    double factor;
} ShareColumn;
static inline ShareColumn share_column(const ScanEvidence *evidence, size_t share) {
    const InkPrior *prior = &evidence->options->ink;
    const double factor = prior->model == INK_FULL ? ink_height(&prior->nominal[share / ORDERS], share % ORDERS) : 1.0;
    return (ShareColumn){evidence->increments.adds + share * evidence->cells, factor};
}

/* Height added to a cell by a change of the shares from those known before [m]. */
static inline double share_change(const ScanEvidence *evidence, const double share[], size_t cell) {
    double change = 0.0;
    for (size_t k = 0; k < evidence->shares; k++) {
        const ShareColumn column = share_column(evidence, k);
        change += (share[k] - evidence->known->share[k]) * column.factor * column.map[cell];
    }
    return change;
}

/* The prediction with these shares, averaged over a spot, and its derivative with respect to the spot. */
void average_prediction(const ScanEvidence *evidence, const double share[], double spread);

/* Readings of a map by the geometry known before: in `reading`, or the map itself in register. Both `lists` are
 * scratch. */
const double *read_map(const ScanEvidence *evidence, const double *map, double *reading);

/* Variance of a displaced reading by the sensor, by the errors of the view model, and at the border [m^2]. spread: of
 * the spot; averaged: of that in `averaged` [cells^2]. */
double sensor_variance(const ScanEvidence *evidence, const Reading *reading, double spread, double averaged);

/* The datum of a scan where the ground has the known height `height`, NULL: 0; `ground` NULL: all cells are ground.
 * noise: variance of a reading [m^2]. */
ScanDatum scan_datum(const ScanEvidence *evidence, const double *scan, const uint8_t *valid, const double *height,
                     const uint8_t *ground, double noise);

/* Marks the ground. */
void mark_ground(const ScanEvidence *evidence);

/* Subtracts the offsets of lines from the scan if neighbours differ more along one axis; returns the remaining variance
 * of a reading [m^2]. */
double take_lines_off(const ScanEvidence *evidence, const ReadingNoise *noise);

/* Whether another explanation fits the scan far better; adds the evidence to `trust`. */
bool doubt_scan(const ScanEvidence *evidence, LoopTrust *trust);

/* Tests after a scan whether the learnt volume of the droplets is credible. */
void doubt_volume(const EstimatorOptions *options, int32_t layer, Knowledge *known);

/* Counts the cells of the part that were not seen, are high, and are capped; into the estimate `after`. */
void look_at_part(const ScanEvidence *evidence);

/* Result of a fit of a scan. */
typedef struct {
    double share[SHARES_MAX], covariance[SHARES_MAX * SHARES_MAX];
    double datum[DATUM_TERMS]; /* correction of the datum [m] */
    double datum_covariance[DATUM_TERMS * DATUM_TERMS];
    double misfit[CLASSES]; /* median squared residual, in variances of droplets and sensor [1] */
    double scatter;         /* mean square residual of cells with a droplet, outliers left out, likewise */
    /* means over cells with a droplet: variance without that of droplets, and of droplets [m^2] */
    double mean_base, mean_droplets;
    size_t droplets; /* number of cells with a droplet */
} InkFit;

/* Whether a fit leaves more than sensor and model's droplets explain. */
bool is_misfit(const InkFit *fit);

/* Least number of readings for a median. */
enum { LEAST_READINGS = 12 };

/* Copies a block of n * n values between matrices of different row length. */
static inline void copy_block(size_t n, const double *from, size_t from_stride, double *into, size_t stride) {
    for (size_t a = 0; a < n; a++)
        memcpy(into + a * stride, from + a * from_stride, n * sizeof *into);
}

/* The share, limited to the volumes that are believed. */
double share_within(double share);

/* Normal equations of datum and changes of the shares by the cells not in `left_out`, with the prior, in rows of
 * `stride` of a matrix of 0. last: the last fit, whose misfit scales the variances. False if the prior is not
 * definite. */
bool smooth_equations(const ScanEvidence *evidence, const uint8_t *left_out, const InkFit *last, size_t stride,
                      double *matrix, double *side);

/* Stores datum and shares in the fit: the last ones of `all` unknowns. */
void take_smooth(const ScanEvidence *evidence, const double *x, const double *covariance, size_t all, InkFit *fit);

/* Fits the scan in register. False if the equations are singular. */
bool fit_in_register(const ScanEvidence *evidence, InkFit *fit);

/* A reading at a wall, and its derivatives with respect to the unknowns: geometry, terms of the datum, and shares. */
enum { DATUM = GEOMETRY, SHARE = DATUM + DATUM_TERMS, FITTED = SHARE + SHARES_MAX, WALLS_MAX = 640 };
typedef struct {
    size_t cell;
    double u, w, column[FITTED], rest, variance, slopes;
    double squares; /* sum of the squares of its droplets' increments [m^2] */
    size_t class;
} Wall;

typedef struct {
    const ScanEvidence *evidence;
    size_t count;
    double spread, share[SHARES_MAX]; /* spot [cells^2] and ink of the averaged prediction */
    double step;                      /* half a step of the difference quotients [cells] */
    Wall walls[WALLS_MAX];
    double values[WALLS_MAX]; /* for medians */
} WallFit;

/* Marks the cells that a geometry of this covariance may move: those near steep cells; all cells if scans are
 * displaced. */
void mark_walls(const ScanEvidence *evidence, const double *covariance);

/* Finds the readings on marked cells. */
void collect_walls(WallFit *fit);

/* Residuals and derivatives of the readings for the unknowns x. */
void look_at_walls(const double *x, WallFit *fit);

/* Median squared error of steep readings in variances, at least 1: divides the weights while the fit is far from its
 * end. */
double heat_of(WallFit *fit, const double *covariance);

/* Residuals in variances, the largest over groups of walls; stores those of the classes, and those that droplets are
 * learnt from, in the fit. */
double misfit_of(WallFit *fit, InkFit *displaced);

/* Log likelihood ratio of the readings, displaced against in register, with datum and shares of one of the fits. */
double likelihood_gained(const WallFit *fit, const InkFit *in_register);

/* Marks the walls, and fits the displaced scan: the registration after it, and `displaced`. It is compared with the fit
 * `in_register`. False if there is no memory. */
bool fit_displaced(const ScanEvidence *evidence, const InkFit *in_register, Registration *registration,
                   InkFit *displaced);

/* Whether a displacement can be the truth, by the residuals that displaced fits of the last scans left. */
bool may_be_displaced(const Registration *registration);

/* Updates the estimate by the scan. False if the fit is singular, or there is no memory. */
bool take_scan(const ScanEvidence *evidence);

typedef struct {
    const ScanEvidence *evidence;
    const InkFit *fit;      /* fit that predicts the heights */
    const double *geometry; /* covariance of the geometry for readings at walls; NULL: none */
    double extra[CLASSES];  /* process noise in addition to that of droplets, in native variances */
    bool is_robust;
    double back[GEOMETRY]; /* inverse geometry of a displaced scan */
} MapUpdate;

/* Counts of an update: readings; surprises of the scan before that vanished, and that lasted; cells without growth. */
enum { SEEN, VANISHED, LASTED, DRY };

/* Updates by a scan in register, and by a displaced one. */
CellSums update_in_register(const MapUpdate *update);
CellSums update_displaced(MapUpdate *update);

/* Update without readings: heights are the predicted ones. */
void live_on_prediction(const ScanEvidence *evidence);

#endif
