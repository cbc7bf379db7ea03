/* From scans to the planner's starting point: the surface, and how much ink a droplet really adds.
 *
 * A Kalman filter per cell on the layer model, around sensor drift, the ink, and cells that were not seen. A layer adds
 * DROPLET_STD^2 times the sum of the squares of what each droplet adds to the cell to the variance of a cell's
 * prediction. Without a given noise of a reading it is what the unprinted cells show; a sensor that shows none is
 * trusted as it is. Errors of neighbours are taken to be independent. A cell whose growth neither explains follows the
 * scan: its droplets differ from the model; where they add nothing layer after layer the cell is dead. */
#ifndef INKLOOP_HEIGHT_ESTIMATOR_H
#define INKLOOP_HEIGHT_ESTIMATOR_H

#include <stdbool.h>

#include "ink_learning.h"
#include "ink_limit.h"
#include "loop_trust.h"
#include "scan_registration.h"

/* Of a droplet's volume about its mean [1]; 20 % uniform variation has 0.06, 40 % 0.12 (assumed). */
#define DROPLET_STD 0.1

typedef struct {
    size_t nx, ny;
    const uint8_t *part;  /* nx * ny cells in C order, as all maps */
    const double *target; /* of the print [m] */
    InkPrior ink;
    int32_t drop_levels;    /* largest number of whole drops of a droplet */
    int32_t flat_ground;    /* layer 0 is flat, of height 0 */
    int32_t take_as_read;   /* neither drift nor noise nor displacement is estimated */
    int32_t register_scans; /* the displacement of the scans is */
    int32_t unseen_layers;  /* that a cell may live on prediction alone and still be trusted */
    double noise_variance;  /* of a reading [m^2]; below 0: not known */
    double steps_variance;  /* of the rounding of a reading [m^2]: the least there is */
    double first_variance;  /* of the height of a cell that the first scan did not measure [m^2] */
} EstimatorOptions;

/* What is known after a scan; the maps are the caller's. */
typedef struct {
    double *height;        /* [m] */
    double *variance;      /* of its error [m^2], but for what a displacement explains */
    int32_t *unseen;       /* layers that each cell has lived on prediction alone */
    double *dead_evidence; /* dead_cells.h */
    double *response;      /* DISPLACEMENTS maps: how the heights err with the displacement, scan_registration.h */
    double *reckoned;      /* height by the droplets alone, no reading of the cell [m] */
    uint8_t *capped;       /* cells that are given no more ink, ink_limit.h */
    Ink ink[INKS_MAX];     /* what the droplets really add */
    InkKnowledge learnt;   /* what that is concluded from */
    Registration registration;
    LoopTrust trust;
    double noise_variance; /* of a reading [m^2] */
    int32_t scans;         /* so far */
} SurfaceEstimate;

/* The surface of layer number `layer`, on which the print begins; a cell that was not measured counts as bare
 * substrate, height 0. False if there is no memory. */
bool estimate_first(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                    SurfaceEstimate *estimate);

/* `layer` was printed on what was known `before`, and scanned: `measured` [m] where `valid`. False if there is no
 * memory. The maps of `before` and `after` are different ones. */
bool estimate_next(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   const double *measured, const uint8_t *valid, SurfaceEstimate *after);

/* The same for a layer that was abandoned at an unknown place: each cell grew by between nothing and what the whole
 * layer adds, so the scan corrects the mean of the two, with the variance of a uniform distribution. Inks and dead
 * cells stay as they were. */
bool estimate_unknown(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                      const double *measured, const uint8_t *valid, SurfaceEstimate *after);

#endif
