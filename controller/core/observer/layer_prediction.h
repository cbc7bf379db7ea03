/* A layer before its scan is used: the droplets of living nozzles, the predicted surface, and its variance. */
#ifndef INKLOOP_LAYER_PREDICTION_H
#define INKLOOP_LAYER_PREDICTION_H

#include "scan_fit.h"

/* Maps of one layer; `room`, `scan`, `slopes` and `ground` are filled after the prediction. */
typedef struct {
    JettedLayer living;           /* without droplets from dead nozzles */
    DropletIncrements increments; /* increments of its layer map */
    double *predicted, *variance; /* predicted heights [m] and their variances [m^2] */
    double *full_own;             /* height that each cell's droplet would leave on it, dead nozzles included [m] */
    double *scan, *slopes;        /* scan without its datum [m]; squared slopes of the prediction [m^2 per cell^2] */
    uint8_t *ground;              /* cells that no droplet reaches */
    FitRoom room;                 /* `marks` holds two maps */
    void *memory;                 /* memory of all maps, released by give_maps */
} LayerMaps;

/* Predicts the surface after a layer. An unknown layer counts as half printed, with the variance of a uniform
 * distribution between nothing and all, and without droplets. False if there is no memory. */
bool predict_layer(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   bool is_unknown, LayerMaps *maps);

#endif
