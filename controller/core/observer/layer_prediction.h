/* A layer before its scan counts: the droplets of nozzles that live, the surface that they leave, and its variance. */
#ifndef INKLOOP_LAYER_PREDICTION_H
#define INKLOOP_LAYER_PREDICTION_H

#include "scan_fit.h"

/* Maps of one layer; `room`, `scan`, `slopes` and `ground` are filled by what follows the prediction. */
typedef struct {
    JettedLayer living;           /* without droplets from dead nozzles */
    DropletIncrements increments; /* ... of its layer map */
    double *predicted, *variance; /* heights [m], and theirs [m^2] */
    double *full_own;             /* what the droplets of cells would leave on them, dead ones too [m] */
    double *scan, *slopes;        /* without its datum [m]; squares, of the prediction [m^2 per cell^2] */
    uint8_t *ground;              /* cells that no droplet reaches */
    FitRoom room;                 /* of which `marks` holds two maps */
    void *memory;                 /* of all maps, to be given back by give_maps */
} LayerMaps;

/* Predicts the surface after a layer. Of an unknown one it is the middle of nothing and all, with the variance of a
 * uniform distribution, and without droplets. False if there is no memory. */
bool predict_layer(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   bool is_unknown, LayerMaps *maps);

#endif
