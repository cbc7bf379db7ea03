/* How sure the predicted heights of a layer are, cell by cell; worked out where it is needed: a map of it is large. */
#ifndef INKLOOP_PREDICTION_VARIANCE_H
#define INKLOOP_PREDICTION_VARIANCE_H

#include <stddef.h>
#include <stdint.h>

#include "instruction_sets.h"

typedef struct {
    const double *before;  /* of the heights before the layer [m^2] */
    const int32_t *unseen; /* cells of which this is 0 have that of a first reading instead; NULL: none */
    double first;          /* of a first reading [m^2] */
    const double *squares; /* of the layer's increments, a sum over its droplets [m^2] */
    double droplets;       /* of a droplet's volume [1] */
    double noise;          /* of a reading [m^2], */
    const double *misread; /* and what a displacement of the scan adds to it [m^2]; NULL: nothing */
} PredictionVariance;

/* Of the predictions of `count` cells from `first` on. */
static INLINED void predicted_variance(const PredictionVariance *by, size_t first, size_t count,
                                       double *restrict variance) {
    const double *before = by->before + first, *squares = by->squares + first, droplets = by->droplets;
    const int32_t *unseen = by->unseen ? by->unseen + first : NULL;
    if (unseen)
        for (size_t k = 0; k < count; k++) {
            const double known = unseen[k] == 0 ? by->first : before[k];
            variance[k] = known + droplets * squares[k];
        }
    else
        for (size_t k = 0; k < count; k++)
            variance[k] = before[k] + droplets * squares[k];
}

/* Of readings about their predictions. */
static INLINED void innovation_variance(const PredictionVariance *by, size_t first, size_t count,
                                        double *restrict variance) {
    const double *misread = by->misread ? by->misread + first : NULL, noise = by->noise;
    predicted_variance(by, first, count, variance);
    for (size_t k = 0; k < count; k++)
        variance[k] += noise;
    for (size_t k = 0; misread && k < count; k++)
        variance[k] += misread[k];
}

#endif
