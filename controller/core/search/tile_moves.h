/* One sweep of a search over one tile of the grid: every move of one sort that its cells can make. */
#ifndef INKLOOP_TILE_MOVES_H
#define INKLOOP_TILE_MOVES_H

#include "change_bound.h"
#include "plan_change.h"

/* Results of a sweep in a tile. */
typedef struct {
    Sums change; /* change of the sums of the surface */
    int64_t evaluations, flips, swaps, shifts;
    bool out_of_time;
} Tally;

/* Sorts of sweeps in addition to MOVE_FLIPS, MOVE_SWAPS and MOVE_SHIFTS. */
enum { MOVE_ANNEAL = 8 };

typedef struct {
    int32_t move;       /* MOVE_...; one_step_sweep takes several */
    double temperature; /* temperature of annealing [m] */
    uint64_t key;       /* key of its random numbers, one for each sweep */
    double deadline;    /* by the stopwatch [s] */
} Sweep;

/* Shift of the bits MOVE_... that mark a move tried without gain, until the plan changes anywhere. */
enum { TRIED = 3 };

/* `awake`: a map with the surface's frame; bit MOVE_... is set on cells where that move may help since the last try.
 * The tile begins with the sums `before` and does not write the surface's own, which other tiles use. The bound may
 * hold data of the present surface from an earlier sweep. */
void tile_sweep(PlanSurface *surface, uint8_t *awake, const Tile *tile, const Sweep *sweep, const Sums *before,
                Window *window, ChangeBound *bound, Tally *tally);

/* Wakes all moves everywhere. The marks of moves tried without gain remain. */
void wake_all(const PlanSurface *surface, uint8_t *awake);

/* Clears these marks after a change of the plan: such moves may help again. */
void forget_tries(const PlanSurface *surface, uint8_t *awake);

/* Wakes all moves on the cells that a change at (i, j) may affect. */
void wake_near(const PlanSurface *surface, uint8_t *awake, size_t i, size_t j);

#endif
