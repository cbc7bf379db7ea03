/* A sweep over the whole grid, tile by tile, on one thread or several with the same bits.
 *
 * Tiles are coloured 2x2. Tiles of one colour are further apart than their windows reach, so they change the shared
 * surface in parallel; each uses the sums from when its colour began, plus its own changes. */
#ifndef INKLOOP_TILED_SWEEP_H
#define INKLOOP_TILED_SWEEP_H

#include "one_step_sweep.h"

typedef struct {
    PlanSurface *surface;
    uint8_t *awake;       /* a map: see tile_sweep */
    uint8_t *stirred;     /* for each tile the moves that some of its cells may be awake for */
    uint8_t *kept;        /* the plan when a colour began: all values of the surface's plan */
    size_t rows, columns; /* number of tiles */
    Tally *tally;         /* one for each tile */
    size_t threads;
    Window *window;     /* one for each thread */
    ChangeBound *bound; /* one for each thread */
    FlipBounds flips;
} Tiling;

/* False if there is no memory. */
bool tiling_open(Tiling *tiling, PlanSurface *surface, int32_t threads);
void tiling_close(Tiling *tiling);

/* Wakes every move of every cell. */
void tiling_wake(Tiling *tiling);

/* Makes one sweep and adds its counts to `report`; returns the number of changes. `out_of_time` reports whether the
 * deadline passed; the plan and the sums are valid in either case. A sweep without annealing never raises the
 * objective: where that depends on more than the sums of each tile, the tiles of a colour go one after another. */
int64_t tiled_sweep(Tiling *tiling, const Sweep *sweep, SearchReport *report, bool *out_of_time);

#endif
