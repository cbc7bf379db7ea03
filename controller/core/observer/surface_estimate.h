/* Knowledge of the surface, of the ink and of the scans, and the options of the observer.
 *
 * The observer keeps a map of heights with a variance for each cell, the volume of each ink, and the geometry of the
 * scans: the place on the printer of each cell's reading, and the width of the spot. observer.h describes the update by
 * a scan. Lengths in metres, geometry in cells. */
#ifndef INKLOOP_SURFACE_ESTIMATE_H
#define INKLOOP_SURFACE_ESTIMATE_H

#include <stdbool.h>

#include "droplet_increments.h"

/* Standard deviation of a droplet's volume about its mean [1] before the scans show it; 20 % uniform variation has
 * 0.06, 40 % 0.12 (assumed). */
#define DROPLET_STD 0.1

/* Degrees of freedom of the prior of that variation (assumed). */
#define FIRST_EVIDENCE 10.0

/* Evidence above which a cell counts as dead: three layers of it; by chance less than once in a million cells (Wald
 * 1945: exp -15). */
#define DEAD_EVIDENCE 15.0

/* Parameters learnt of each ink: its droplet volume; h1, h2 and h3 as far as the patterns distinguish them; none. */
enum { INK_SCALE = 1, INK_FULL = 2, INK_OFF = 3 };
enum { SHARES_MAX = INKS_MAX * ORDERS };

typedef struct {
    size_t inks;
    Ink nominal[INKS_MAX];
    int32_t model; /* INK_... */
} InkPrior;

typedef struct {
    size_t nx, ny;
    const uint8_t *part;  /* nx * ny cells in C order, as all maps */
    const double *target; /* target height of the print [m] */
    InkPrior ink;
    int32_t drop_levels;              /* largest number of single drops in a droplet */
    int32_t flat_ground;              /* layer 0 is flat, of height 0 */
    int32_t take_as_read;             /* no estimation: heights are the readings */
    int32_t register_scans;           /* the geometry of the scans is estimated */
    int32_t unseen_layers;            /* layers that a cell may live on prediction alone and still be trusted */
    double noise_variance;            /* variance of a reading [m^2]; below 0: not known */
    double steps_variance;            /* variance of the rounding of a reading [m^2]: the least possible */
    double first_variance;            /* variance of the height of a cell that the first scan did not measure [m^2] */
    double volume_least, volume_most; /* credible volume of the droplets, as a share of the nominal one [1] */
} EstimatorOptions;

/* Shift along x and y, linear part, variance of the spot. The reading of cell (i, j) is that of the surface, averaged
 * over a spot of variance g[SPREAD] [cells^2], at
 *     i + g[0] + g[2] u + g[3] w,   j + g[1] + g[4] u + g[5] w   [cells],
 * where u and w go from -1 to 1 over the grid along x and y. */
enum { SHIFT_X, SHIFT_Y, ALONG_X_U, ALONG_X_W, ALONG_Y_U, ALONG_Y_W, SPREAD, GEOMETRY };

/* Half of the grid along an axis [cells]. */
static inline double half_of(size_t count) {
    return 0.5 * (count > 2 ? (double)count - 1.0 : 1.0);
}

enum { REMEMBERED = 3 }; /* scans remembered */

typedef struct {
    double estimate[GEOMETRY]; /* after the last scan */
    double covariance[GEOMETRY * GEOMETRY];
    double steps[2];            /* learnt: variance of the shift from scan to scan [cells^2] */
    double odds;                /* log odds that scans are displaced rather than in register */
    double misfits[REMEMBERED]; /* misfits of displaced fits, last scan first, in variances of droplets and sensor */
    int64_t fits;               /* scans fitted */
    int64_t is_displaced;       /* scans count as displaced */
    int64_t is_shifted;         /* first scans show a shift that foreign droplets do not explain */
} Registration;

enum { DATUM_TERMS = 6 }; /* offset, tilts and bows of a scan, in u and w */

/* Whole scans that do not show what was printed: hypotheses, in the order of scan_doubts.c. The transforms of a grid
 * come last; those that exchange its axes fit square grids only. */
enum {
    DOUBT_NO_GROWTH,
    DOUBT_SAME_SCAN,
    DOUBT_MIRRORED_X,
    DOUBT_MIRRORED_Y,
    DOUBT_TURNED_180,
    DOUBT_TRANSPOSED,
    DOUBT_TURNED_90,
    DOUBT_TURNED_270,
    DOUBT_ANTITRANSPOSED,
    DOUBTS
};

/* Reasons why a print is not trusted, to be added up; from STOP_NO_GROWTH on they stop it. */
enum {
    UNTRUSTED_UNSEEN = 1,    /* cells of the part have lived on prediction for too many layers */
    UNTRUSTED_BLIND = 2,     /* most of the part was not measured in the last scans */
    UNTRUSTED_GROUND = 4,    /* the first scan shows ground called flat far from height 0 */
    UNTRUSTED_RESIDUALS = 8, /* scans differ from predictions by more than droplets and sensor explain */
    UNTRUSTED_INK = 16,      /* cells are capped: by the droplets that they were given they are high enough */
    UNTRUSTED_HIGH = 32,     /* cells stand higher than their target and their droplets explain */
    STOP_NO_GROWTH = 64,     /* nothing grew where droplets were jetted */
    STOP_SAME_SCAN = 128,    /* the sensor shows an earlier scan again */
    STOP_LATE = 256,         /* scans show the surface of an earlier layer */
    STOP_TURNED = 512,       /* scans are mirrored or turned against the patterns */
    STOP_VOLUME = 1024       /* droplets have a volume that no ink is believed to have */
};

typedef struct {
    /* first scan on ground called flat: height of its middle, and its rise over the grid along x and y [m] */
    double ground[3];
    double early; /* mean square of the residuals of the first layers, in variances of droplets [1] */
    /* mean square of the residuals of all layers, recent ones more, in learnt variances of droplets and sensor [1] */
    double surprise;
    double spill;          /* the same for cells that only neighbours' droplets reach: near 1 where the model holds */
    double blind_share;    /* share of the part that the last scan did not measure */
    double excess;         /* largest height missing on a cell against its droplets [m] */
    double rise;           /* largest height of a cell above its target and above its droplets [m] */
    double doubts[DOUBTS]; /* evidence for each explanation; halved from scan to scan */
    double volume_doubt;
    int64_t excess_cell, rise_cell; /* cells of these two maxima */
    int64_t layers;                 /* layers that count in the residuals */
    int64_t capped_cells, unseen_cells, high_cells, blind_layers;
    int64_t ground_wrong;       /* the ground is not flat at height 0 */
    int64_t stop;               /* STOP_... of the first scan that stopped the print; 0: none did */
    int64_t stop_layer;         /* layer of that scan */
    int64_t is_looked_at;       /* a person has looked: the next scan is accepted unchecked */
    int64_t is_volume_believed; /* any learnt volume is accepted: a person has looked */
    int64_t transform;          /* the DOUBT_... of mirrored or turned scans */
    double stop_figure;         /* ratio by which the scan fits better than as read; or a volume [1] */
} LoopTrust;

/* Variances of a reading on ground, outliers left out [m^2]. */
typedef struct {
    double variance;      /* about the datum; below 0: too few cells */
    double neighbours[2]; /* by the differences of neighbours along x and along y */
    double freedom;       /* degrees of freedom */
} ReadingNoise;

/* All knowledge besides the maps; numbers without padding. */
typedef struct {
    Registration registration;
    LoopTrust trust;
    double share[SHARES_MAX]; /* shares of the nominal ink: volumes, or heights h1, h2, h3 of each */
    double share_covariance[SHARES_MAX * SHARES_MAX];
    double datum[DATUM_TERMS];        /* datum of the last scan [m] */
    double datum_spread[DATUM_TERMS]; /* variance of each term over the scans, learnt [m^2] */
    ReadingNoise noise;
    double droplet_variance;   /* variance of a droplet's volume in DROPLET_STD^2, learnt */
    double droplet_evidence;   /* degrees of freedom of that variance */
    double vanishing, lasting; /* shares of readings with a surprise that vanished, and that lasted */
    int64_t scans;             /* scans so far */
} Knowledge;

/* Estimate after a scan; all memory is the caller's. */
typedef struct {
    double *height;        /* [m] */
    double *variance;      /* variance of the height's error [m^2] */
    double *ledger;        /* height by the droplets alone, of nominal volume [m]; no reading enters */
    double *last;          /* the last scan [m] */
    double *surprise;      /* residual of a reading that no droplet and no noise explains [m]; else 0 */
    double *dead_evidence; /* log likelihood ratio: no droplet against a weak one [1] */
    int32_t *unseen;       /* layers that each cell has lived on prediction alone */
    uint8_t *last_valid;
    uint8_t *surprised; /* surprises in a row */
    uint8_t *capped;    /* cells that get no more ink */
    Knowledge *known;
} SurfaceEstimate;

/* Size in bytes of an estimate in one block, and the estimate in such a block. */
size_t estimate_size(size_t cells);
SurfaceEstimate estimate_in(void *block, size_t cells);

/* Number of shares of the inks, and the learnt inks. */
size_t ink_shares(const InkPrior *prior);
void learnt_inks(const EstimatorOptions *options, const Knowledge *known, Ink ink[INKS_MAX]);

/* Takes the heights of each ink in nominal proportions, and holds them there: the volume remains of what was learnt, as
 * displaced scans and wide spots pass for other heights. share, covariance: of INK_FULL, changed. */
void take_volumes_alone(const EstimatorOptions *options, double *share, double *covariance);

/* Volume of the learnt inks as a share of the nominal one, mean over the inks. */
double learnt_volume(const EstimatorOptions *options, const Knowledge *known);

/* Height of a nominal full layer, the largest of the inks [m]. */
double layer_of(const EstimatorOptions *options);

/* Knowledge before any scan. */
Knowledge first_knowledge(const EstimatorOptions *options);

/* Whether droplets spill onto their neighbours unlike the model's. */
bool is_spill_foreign(const LoopTrust *trust);

/* Whether dead cells are tried again in layer number `layer`: a nozzle may have been cleaned. */
bool is_probe(int64_t layer);

/* Figures of an estimate: those reported, and those that a plan needs besides the surface. */
typedef struct {
    Ink ink[INKS_MAX];  /* learnt heights of the droplets */
    double volume;      /* learnt volume as a share of the nominal one, mean over the inks [1] */
    double droplet_std; /* standard deviation of a droplet's volume, as a share of it; 0 before any layer */
    double noise_std;   /* standard deviation of a reading [m] */
    double ground[3];   /* first scan on ground called flat: middle, rise over the grid along x and y [m] */
    /* residuals of scans against predictions, in standard deviations of droplets and sensor */
    double surprise;
    double blind_share;             /* share of the part that the last scan did not measure */
    double excess, rise;            /* as in LoopTrust [m] */
    double shift_x, shift_y;        /* shift of the last scan in the middle of the grid [cells] */
    double shift_std;               /* standard deviation of the shift, the larger one [cells] */
    double spot_radius, spot_std;   /* standard deviation of the spot, and of its error [cells] */
    double rotation, magnification; /* rotation and magnification of the scans against the printer [rad, 1] */
    double stop_figure;             /* as in LoopTrust */
    int64_t reasons;                /* UNTRUSTED_... and STOP_..., added up */
    int64_t stop, stop_layer, transform;
    int64_t unseen_cells, dead_cells, capped_cells, excess_cell, rise_cell;
    int64_t is_displaced; /* scans count as displaced */
    /* droplets spill onto their neighbours unlike the model's: plans that look far ahead promise more than such a plant
     * keeps */
    int64_t is_foreign;
    int64_t scans;
} EstimateFigures;

EstimateFigures estimate_figures(const EstimatorOptions *options, const SurfaceEstimate *estimate);

#endif
