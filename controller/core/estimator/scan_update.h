/* What a scan in register changes in the estimate, cell by cell. */
#ifndef INKLOOP_SCAN_UPDATE_H
#define INKLOOP_SCAN_UPDATE_H

#include "displacement_response.h"
#include "row_ranges.h"
#include "surface_estimate.h"

/* Of the rows of a chunk. */
typedef struct {
    size_t part_cells, dry, trials, revived; /* cells; dry: that look as if nothing came */
    size_t droplets, spills;                 /* lengths of the lists: of cells with a droplet, of others */
    double built, wanted;                    /* heights of the part, before the layer and in the end [m] */
    double variance;                         /* of the cells of `spills` together [m^2] */
} ChunkSums;

/* Maps for lists of what cells show: those with a droplet, others that droplets reach; and room for their medians,
 * where the surface may stand until the cells are corrected. */
enum { DROPLETS, SPILLS, ROOM, LISTS };

/* A layer that was scanned, what was known before, and maps for what is known after. The threads share it. */
typedef struct {
    const EstimatorOptions *options;
    const SurfaceEstimate *before;
    const JettedLayer *layer;
    const RegisteredScan *registered;
    const PredictionVariance *variance;
    const DropletIncrements *increments; /* squares, own: where the variances and the evidence of `after` will stand */
    const Ink *ink;                      /* whose proportions are expected of the growth */
    const double *surface;               /* that is predicted after the layer [m] */
    double *values[LISTS];               /* maps */
    uint8_t *marks;                      /* two maps */
    SurfaceEstimate *after;              /* with its ink, and the surface that is reckoned with whole volumes */
    bool is_unknown;                     /* it is not known how much came: the growth tells nothing of droplets */
    bool has_trials;                     /* of dead cells */
    bool is_dry;                         /* the head */
    double volume;                       /* of the droplets, by the cells with one [1] */
    ChunkSums sums[CHUNKS];
} ScanUpdate;

/* What the cells grew by: whose droplets do not come, and how well the prediction explains the rest. */
void look_at_growth(ScanUpdate *scan);

/* Corrects the heights, their variances and the response, and carries the evidence of dead cells and the reckoning on;
 * after look_at_growth. Returns how many cells come alive again. */
size_t correct_cells(ScanUpdate *scan);

#endif
