/* One changed droplet of a plan that is printed in one step, and a second one near it: heights, costs and sums.
 *
 * The surface under the droplets stays, so the shares of a droplet depend on no other droplet: a change subtracts the
 * shares of the old one and adds those of the new one, all multiples of one length (lattice.h). They are computed
 * without a branch in three rows of LANES cells, the droplet in the middle of the first three; the last cell of a row
 * is beyond its reach. */
#ifndef INKLOOP_ONE_STEP_CELLS_H
#define INKLOOP_ONE_STEP_CELLS_H

#include "plan_surface.h"

enum { LANES = 4, THREE = 3 * LANES, MIDDLE = LANES + 1 };

/* Cell (i, j) gets another value of a plan. */
typedef struct {
    size_t i, j;
    unsigned from, to;
} CellChange;

/* Result of one change on its cells. */
typedef struct {
    double height[THREE], cost[THREE]; /* heights and costs after the change [m] */
    double chance;                     /* uncertainty of its own cell after the change [m] */
    Sums sums;                         /* change of the sums */
} ChangedCells;

enum { REACH_ROWS = 5, REACH_LANES = 8, REACH_MIDDLE = 2 };

/* Result of a first change on the cells affected by a second change of a neighbour; 0 on the others. */
typedef struct {
    double raised[REACH_ROWS * REACH_LANES], dearer[REACH_ROWS * REACH_LANES], is_own[REACH_ROWS * REACH_LANES];
    double chance; /* uncertainty of its own cell after the change [m] */
    Sums sums;
} FirstChange;

/* Offset of the cells of a neighbour, 0 to 2 rows and columns from the first, in those of a FirstChange. */
static inline size_t near_of(size_t rows, size_t columns) {
    return rows * REACH_LANES + columns;
}

/* Begins without a first change. */
static inline void first_open(FirstChange *first) {
    *first = (FirstChange){.is_own = {[REACH_MIDDLE * REACH_LANES + REACH_MIDDLE] = 1.0}};
}

/* Evaluates a change alone; cost_alone: the other sums stay 0. */
void look_at_change(const PlanSurface *surface, const CellChange *change, bool cost_alone, ChangedCells *cells);

/* The same for a change that a second one follows. */
void look_at_first(const PlanSurface *surface, const CellChange *change, bool cost_alone, FirstChange *first);

/* Change of the sums by a first change and a second one, whose cells begin at `near` among those of the first. */
Sums look_at_second(const PlanSurface *surface, const FirstChange *first, size_t near, const CellChange *change,
                    bool cost_alone);

/* Executes the change that was evaluated. */
void put_cells(PlanSurface *surface, const CellChange *change, const ChangedCells *cells);

#endif
