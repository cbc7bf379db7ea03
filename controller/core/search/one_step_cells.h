/* One changed droplet of a plan that is printed in one step, and a second one near it: heights, costs and sums.
 *
 * The surface under the droplets stays, so what a droplet gives to its cells depends on no other droplet: a change
 * takes the shares of the old one away and adds those of the new one, all multiples of one length (lattice.h). They are
 * looked at in three rows of LANES cells, the droplet in the middle of the first three, without a branch; the last cell
 * of a row is beyond its reach. */
#ifndef INKLOOP_ONE_STEP_CELLS_H
#define INKLOOP_ONE_STEP_CELLS_H

#include "plan_surface.h"

enum { LANES = 4, THREE = 3 * LANES, MIDDLE = LANES + 1 };

/* Cell (i, j) gets another value of a plan. */
typedef struct {
    size_t i, j;
    unsigned from, to;
} CellChange;

/* What a change alone makes of its cells. */
typedef struct {
    double height[THREE], cost[THREE]; /* from now on [m] */
    double chance;                     /* of its own cell, from now on [m] */
    Sums sums;                         /* what it adds to them */
} ChangedCells;

enum { REACH_ROWS = 5, REACH_LANES = 8, REACH_MIDDLE = 2 };

/* What a change does to the cells that a change of a neighbour can be felt on; 0 where nothing. */
typedef struct {
    double raised[REACH_ROWS * REACH_LANES], dearer[REACH_ROWS * REACH_LANES], is_own[REACH_ROWS * REACH_LANES];
    double chance; /* of its own cell, from now on [m] */
    Sums sums;
} FirstChange;

/* Where the cells of a neighbour, 0 to 2 rows and columns from the first, begin among those of a FirstChange. */
static inline size_t near_of(size_t rows, size_t columns) {
    return rows * REACH_LANES + columns;
}

/* Begins with no first change. */
static inline void first_open(FirstChange *first) {
    *first = (FirstChange){.is_own = {[REACH_MIDDLE * REACH_LANES + REACH_MIDDLE] = 1.0}};
}

/* Looks at a change alone; cost_alone: the other sums stay 0. */
void look_at_change(const PlanSurface *surface, const CellChange *change, bool cost_alone, ChangedCells *cells);

/* The same of one that another one follows. */
void look_at_first(const PlanSurface *surface, const CellChange *change, bool cost_alone, FirstChange *first);

/* What a first change and another one in addition, whose cells begin at `near` among those of the first, add to the
 * sums. */
Sums look_at_second(const PlanSurface *surface, const FirstChange *first, size_t near, const CellChange *change,
                    bool cost_alone);

/* Makes the change that was looked at. */
void put_cells(PlanSurface *surface, const CellChange *change, const ChangedCells *cells);

#endif
