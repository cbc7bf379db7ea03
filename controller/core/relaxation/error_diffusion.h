/* Whole droplets from relaxed ones: ordered error diffusion (Floyd, Steinberg 1976) of their sums over the horizon, and
 * ordered dither (Bayer 1973) of a single layer. */
#ifndef INKLOOP_ERROR_DIFFUSION_H
#define INKLOOP_ERROR_DIFFUSION_H

#include "horizon_problem.h"

/* Every cell gets a whole number of droplets near the sum of its relaxed ones; the rounding error is passed on to its
 * neighbours that may get droplets at all. The last layers are filled first: a full layer flows into the gaps that a
 * partial one left below. Where a size is not among a cell's choices, the next smaller one falls. Returns CORE_DONE,
 * CORE_NO_MEMORY, or CORE_TIME if `ends_at` by the stopwatch came first: then the plan is invalid. The chunks of
 * a large grid are rounded each as a grid of its own: a sweep back and forth is one thread's work. The same input gives
 * the same bits for any number of threads. */
int32_t diffuse_droplets(const HorizonProblem *problem, int32_t threads, const double *droplets, double ends_at,
                         int32_t *plan);

/* Jets a droplet of a cell's first kind where its relaxed droplet exceeds a threshold, one of sixteen that repeat every
 * four cells: equal shares give a regular pattern. */
void dither_droplets(const HorizonProblem *problem, int32_t threads, const double *droplets, int32_t *plan);

#endif
