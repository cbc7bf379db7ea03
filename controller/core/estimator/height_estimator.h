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

#include "surface_estimate.h"

/* The surface of layer number `layer`, on which the print begins; a cell that was not measured counts as bare
 * substrate, height 0. False if there is no memory. */
bool estimate_first(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                    SurfaceEstimate *estimate);

/* `layer` was printed on what was known `before`, and scanned: `measured` [m] where `valid`. False if there is no
 * memory. The maps of `before` and `after` are different ones, but for the response: where that is the same one, it is
 * only written when nothing can fail any longer. */
bool estimate_next(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   const double *measured, const uint8_t *valid, SurfaceEstimate *after);

/* The same for a layer that was abandoned at an unknown place: each cell grew by between nothing and what the whole
 * layer adds, so the scan corrects the mean of the two, with the variance of a uniform distribution. Inks and dead
 * cells stay as they were. */
bool estimate_unknown(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                      const double *measured, const uint8_t *valid, SurfaceEstimate *after);

#endif
