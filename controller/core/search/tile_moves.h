/* One sweep of a search over one tile of the grid: every move of one sort that its cells can make. */
#ifndef INKLOOP_TILE_MOVES_H
#define INKLOOP_TILE_MOVES_H

#include "change_bound.h"
#include "plan_change.h"

/* What a sweep did in a tile. */
typedef struct {
    Sums change; /* of the sums of the surface */
    int64_t evaluations, flips, swaps, shifts;
    bool out_of_time;
} Tally;

/* Sorts of sweeps in addition to MOVE_FLIPS, MOVE_SWAPS and MOVE_SHIFTS. */
enum { MOVE_ANNEAL = 8 };

typedef struct {
    int32_t move;       /* MOVE_...; one_step_sweep takes several */
    double temperature; /* of annealing [m] */
    uint64_t key;       /* of its random numbers, one for each sweep */
    double deadline;    /* by the stopwatch [s] */
} Sweep;

/* Cells where a move was tried in vain have its bit MOVE_... so many bits further up, until the plan changes anywhere.
 */
enum { TRIED = 3 };

/* `awake`: a map with the surface's frame; bit MOVE_... is set on cells where that move may have begun to help. The
 * tile begins with the sums `before` and leaves the surface's own alone: other tiles may be at work. The bound may know
 * the surface as it is, from a sweep before. */
void tile_sweep(PlanSurface *surface, uint8_t *awake, const Tile *tile, const Sweep *sweep, const Sums *before,
                Window *window, ChangeBound *bound, Tally *tally);

/* Sets all moves awake everywhere. What was tried in vain since the last change remains known. */
void wake_all(const PlanSurface *surface, uint8_t *awake);

/* Somewhere the plan has changed: what was tried in vain may help. */
void forget_tries(const PlanSurface *surface, uint8_t *awake);

/* Sets all moves awake on the cells that may feel a change at (i, j). */
void wake_near(const PlanSurface *surface, uint8_t *awake, size_t i, size_t j);

#endif
