/* What an estimate makes doubtful: its ground, its reckoning, and cells that were not seen or do not answer. */
#ifndef INKLOOP_ESTIMATE_DOUBTS_H
#define INKLOOP_ESTIMATE_DOUBTS_H

#include "surface_estimate.h"

/* The reckoning begins on the ground of layer number `layer`: the one that is called flat, or that the scan shows. */
void begin_trust(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                 SurfaceEstimate *estimate);

/* Cells that were not seen, and those that were given more ink than they show; the latter are capped. What is found
 * does not depend on the threads. */
void look_at_cells(const EstimatorOptions *options, const uint8_t *valid, size_t threads, SurfaceEstimate *estimate);

/* Takes out of the reckoning what did not come while a cell was dead and is alive now; at a wall, where a displaced
 * scan shows cells that are neither, only where such cells reach from inside to it. `marks` holds two maps. */
void forgive_dead(const EstimatorOptions *options, const SurfaceEstimate *before, uint8_t *marks,
                  SurfaceEstimate *after);

#endif
