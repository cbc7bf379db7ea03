/* Flips and swaps in one tile of a plan that is printed in one step, until none helps: the work of tile_moves.h in a
 * fifth of the time, and on the tile while it is in the cache. */
#ifndef INKLOOP_ONE_STEP_SWEEP_H
#define INKLOOP_ONE_STEP_SWEEP_H

#include "flip_bounds.h"
#include "tile_moves.h"

/* As tile_sweep, for a surface of one step, and MOVE_FLIPS, MOVE_SWAPS or both; work: cells printed so far, in all
 * trials.
 * Where the cost alone counts (is_cost_enough) the tally's other sums stay 0. */
void one_step_sweep(PlanSurface *surface, uint8_t *awake, const Tile *tile, const Sweep *sweep, const Sums *before,
                    FlipBounds *flips, int64_t *work, Tally *tally);

#endif
