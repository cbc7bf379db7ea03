/* What is known of the surface and of the ink, and by which options. */
#ifndef INKLOOP_SURFACE_ESTIMATE_H
#define INKLOOP_SURFACE_ESTIMATE_H

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

static inline bool registers_scans(const EstimatorOptions *options) {
    return !options->take_as_read && options->register_scans;
}

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

#endif
