/* One changed droplet of a plan that is printed in one step, and a second one near it: heights, costs and sums.
 *
 * The surface under the droplets stays, so what a droplet gives to its cells depends on no other droplet, and is worth
 * keeping: a change takes the shares of the old one away and adds those of the new one, all multiples of one length
 * (lattice.h). They are looked at in three rows of LANES cells, the droplet in the middle of the first three, without a
 * branch; the last cell of a row is beyond its reach. */
#ifndef INKLOOP_ONE_STEP_CELLS_H
#define INKLOOP_ONE_STEP_CELLS_H

#include "plan_surface.h"

enum { LANES = 4, THREE = 3 * LANES, MIDDLE = LANES + 1 };

/* A change; first: the map's cell that is the first of its cells. */
typedef struct {
    size_t first;
    const double *gone, *come; /* what the old droplet gave to its cells and what the new one gives, or NO_SHARES [m] */
} CellsChange;

extern const double NO_SHARES[THREE];

enum { REACH_ROWS = 5, REACH_LANES = 8, REACH_MIDDLE = 2 };

/* What a change does to the cells that a change of a neighbour can be felt on; 0 where nothing. */
typedef struct {
    double raised[REACH_ROWS * REACH_LANES], cost[REACH_ROWS * REACH_LANES], is_own[REACH_ROWS * REACH_LANES];
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

/* What a droplet on the middle of the cells from `first` on gives to each of them [m]. */
void take_shares(const PlanSurface *surface, size_t first, unsigned value, double *shares);

/* What a change alone adds to the sums; cost_alone: the other sums stay 0. */
Sums look_at_change(const PlanSurface *surface, const CellsChange *change, bool cost_alone);

/* The same of one that another one follows. */
void look_at_first(const PlanSurface *surface, const CellsChange *change, bool cost_alone, FirstChange *first);

/* What a first change and another one in addition, whose cells begin at `near` among those of the first, add to the
 * sums. */
Sums look_at_second(const PlanSurface *surface, const FirstChange *earlier, size_t near, const CellsChange *change,
                    bool cost_alone);

#endif
