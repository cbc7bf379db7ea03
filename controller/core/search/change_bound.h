/* What changes of a plan do to the objective at least, from the cells near them alone: enough to leave out nearly all
 * of the changes that are in vain, of which a search tries fifty for each one that it makes.
 *
 * Changes are carried through the steps among the near cells in single precision. Their costs and squares are convex in
 * the heights, so what is out of sight, and what is rounded, can be worth no more than its sum times the steepest slope
 * there is. */
#ifndef INKLOOP_CHANGE_BOUND_H
#define INKLOOP_CHANGE_BOUND_H

#include "near_flow.h"

/* Room for the near cells of one thread, and what was read of them last. */
typedef struct {
    NearRules rules;
    NearStep *step;      /* one for each step; NULL: there is no bound */
    size_t i, j;         /* the cell in the middle, ... */
    bool is_read;        /* ... if that was read, ... */
    size_t unread;       /* ... with the steps from this one on */
    double cost_slope;   /* cost of a metre on any cell, at most */
    double chance_slope; /* of a metre on any cell, by what is left to chance */
    double height_most;  /* of cells that changes can reach, above or below the reference [m] */
    /* The near cells after the last step: 1 on the grid, 0 beyond; error and height above the ceiling, as far as
     * changes can reach, and above the reference [m]; weight; 1 in the part, 0 outside; left to chance, and cost [m].
     */
    float is_cell[NEAR_CELLS], error[NEAR_CELLS], above[NEAR_CELLS], height[NEAR_CELLS], weight[NEAR_CELLS];
    float inside[NEAR_CELLS], chance[NEAR_CELLS], cost[NEAR_CELLS];
} ChangeBound;

/* False if there is no memory. Changes of few steps have no bound: they are tried as quickly. */
bool bound_open(ChangeBound *bound, const PlanSurface *surface);
void bound_close(ChangeBound *bound);

/* The surface has changed since the last bound. */
static inline void bound_renew(ChangeBound *bound) {
    bound->is_read = false;
}

/* What the changes do to the objective at least, with the sums that there are; -infinity if nothing is known. They are
 * on cell (i, j), or on it and one that touches it. */
double change_bound(ChangeBound *bound, const PlanSurface *surface, size_t i, size_t j, const Change *change,
                    size_t count, const Sums *sums);

#endif
