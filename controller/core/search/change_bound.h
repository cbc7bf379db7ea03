/* What changes of a plan do to the objective at least, from the cells near them alone: enough to leave out nearly all
 * of the changes that are in vain, of which a search tries fifty for each one that it makes.
 *
 * Changes are carried through the steps among the near cells in single precision. Their costs and squares are convex in
 * the heights, so what is out of sight, and what is rounded, can be worth no more than its sum times the steepest slope
 * there is. */
#ifndef INKLOOP_CHANGE_BOUND_H
#define INKLOOP_CHANGE_BOUND_H

#include "near_flow.h"

/* Room for the tile of one thread, and what was read of it. */
typedef struct {
    NearRules rules;
    NearMaps maps; /* without steps there is no bound */
    bool is_known; /* rows were read of `tile`, and nothing has changed since */
    Tile tile;
    ptrdiff_t top, bottom; /* rows of the maps that were read, bottom excluded */
    double cost_slope;     /* cost of a metre on any cell, at most */
    double chance_slope;   /* of a metre on any cell, by what is left to chance */
    double height_most;    /* of cells that changes can reach, above or below the reference [m] */
    /* Maps of the cells after the last step: error and height above the ceiling, as far as changes can reach, and above
     * the reference [m]; weight; 1 in the part, 0 outside; left to chance, and cost [m]. */
    float *error, *above, *height, *weight, *inside, *chance, *cost;
    void *memory;
} ChangeBound;

/* False if there is no memory. Changes of few steps have no bound: they are tried as quickly. */
bool bound_open(ChangeBound *bound, const PlanSurface *surface);
void bound_close(ChangeBound *bound);

/* The surface may be any other since the last bound. */
static inline void bound_renew(ChangeBound *bound) {
    bound->is_known = false;
}

/* Changes of cells of the tile follow. */
void bound_begin(ChangeBound *bound, const PlanSurface *surface, const Tile *tile);

/* The surface has changed in a box of its maps. */
void bound_change(ChangeBound *bound, const PlanSurface *surface, const Box *changed);

/* What the changes do to the objective at least, with the sums that there are; -infinity if nothing is known. They are
 * on cell (i, j) of the tile, or on it and one that touches it. */
double change_bound(ChangeBound *bound, const PlanSurface *surface, size_t i, size_t j, const Change *change,
                    size_t count, const Sums *sums);

#endif
