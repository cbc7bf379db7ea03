/* Descent by flips (put or take one droplet) and swaps (move one to a neighbouring cell) in raster order. */
#ifndef INKLOOP_FLIP_SEARCH_H
#define INKLOOP_FLIP_SEARCH_H

#include "layer_surface.h"

/* Sweeps flips until none helps, then swaps, and so on; until `report` counts `sweeps_max` sweeps. Counts what it did
 * in `report`. Returns CORE_DONE or CORE_BUDGET. */
int32_t flip_search(LayerSurface *surface, int64_t sweeps_max, SearchReport *report);

#endif
