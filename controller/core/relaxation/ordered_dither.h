/* Whole droplets from relaxed ones of a single layer: ordered dither (Bayer 1973). */
#ifndef INKLOOP_ORDERED_DITHER_H
#define INKLOOP_ORDERED_DITHER_H

#include "horizon_problem.h"

/* Jets a droplet of a cell's first kind where its relaxed droplet exceeds a threshold, one of sixteen that repeat every
 * four cells: equal shares give a regular pattern. */
void dither_droplets(const HorizonProblem *problem, const double *droplets, int32_t *plan);

#endif
