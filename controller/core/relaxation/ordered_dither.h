/* Whole droplets from relaxed ones of a single layer: ordered dither (Bayer 1973). */
#ifndef INKLOOP_ORDERED_DITHER_H
#define INKLOOP_ORDERED_DITHER_H

#include "horizon_problem.h"

/* A cell gets a droplet of its first kind where it wants more than its threshold, one of sixteen that repeat every four
 * cells: where all want the same share, droplets fall in a regular pattern. */
void dither_droplets(const HorizonProblem *problem, const double *droplets, int32_t *plan);

#endif
