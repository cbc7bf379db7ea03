/* Simulated annealing by single flips: leaves the local optima that flips and swaps cannot. */
#ifndef INKLOOP_ANNEALING_H
#define INKLOOP_ANNEALING_H

#include "layer_surface.h"

/* `sweeps` sweeps in raster order from hot to cold; the pattern it ends with still wants a descent. The temperature is
 * set by the height of a droplet, so that it suits every ink and grid. The same seed gives the same bits. */
void anneal(LayerSurface *surface, int64_t sweeps, uint64_t seed, SearchReport *report);

#endif
