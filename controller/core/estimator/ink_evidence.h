/* What one layer shows of its inks. */
#ifndef INKLOOP_INK_EVIDENCE_H
#define INKLOOP_INK_EVIDENCE_H

#include "ink_identification.h"
#include "prediction_variance.h"

/* What a layer did, cell by cell. */
typedef struct {
    const JettedLayer *layer;
    const uint8_t *part;
    const uint8_t *seen;                /* cells whose growth was measured */
    DropletIncrements increments;       /* of its droplets on the surface before */
    const double *before, *scan;        /* heights, between which it was measured [m] */
    const PredictionVariance *variance; /* with the noise of its reading */
} ObservedLayer;

/* Adds a layer to the evidence, or leaves it unchanged if the layer contains too little. `values` and `marks`
 * hold two maps. */
void add_ink_evidence(const InkPrior *prior, const ObservedLayer *layer, double *values, uint8_t *marks,
                      InkEvidence *evidence);

#endif
