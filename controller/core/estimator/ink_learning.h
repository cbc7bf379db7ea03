/* The ink of a print, learnt from its layers, as the one that has predicted the scans better.
 *
 * Three heights that patterns distinguish (INK_FULL) fit a printer of another kind too, and plans by them may be worse
 * than by its volumes alone (INK_SCALE). So both are learnt, each predicts every scan before it is read, and what the
 * planner gets are the three heights if their errors are clearly smaller. */
#ifndef INKLOOP_INK_LEARNING_H
#define INKLOOP_INK_LEARNING_H

#include "ink_evidence.h"

typedef struct {
    InkEvidence evidence; /* for the model of the prior */
    InkEvidence volumes;  /* for the volumes, while the model is INK_FULL */
    double errors[2];     /* what each predicted wrong: sums of squares beyond the scatter of the scans, recent layers
                             more [m^2] */
} InkKnowledge;

/* A layer that was jetted and scanned, and maps for what it shows. */
typedef struct {
    const JettedLayer *layer;
    const uint8_t *part, *clear;        /* cells of the part; cells whose growth is sure */
    const double *before, *scan;        /* heights before the layer, and the scan [m] */
    const PredictionVariance *variance; /* of the prediction, by the squares of `increments` */
    DropletIncrements increments;       /* out: of the layer on the surface before */
    Ink *held;       /* the inks whose widths the increments have; of no volume: they are still to be taken */
    double *scratch; /* two maps */
    double *values;  /* a map */
    uint8_t *marks;  /* two maps */
} LearntLayer;

/* The ink after a layer, and the ink whose widths of saturation its increments were taken with. */
void learn_ink(const InkPrior *prior, const InkKnowledge *before, const LearntLayer *layer, InkKnowledge *after,
               Ink ink[INKS_MAX], Ink widths[INKS_MAX]);

#endif
