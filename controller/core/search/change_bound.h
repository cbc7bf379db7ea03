/* Lower bounds of the change of the objective by changes of a plan, from the cells near them alone. They exclude nearly
 * all changes that do not help, of which a search tries fifty for each one that it makes.
 *
 * Changes are propagated through the steps among the near cells in single precision. Costs and squares are convex in
 * the heights, so differences out of sight and rounding change the objective by at most their sum times the steepest
 * slope. */
#ifndef INKLOOP_CHANGE_BOUND_H
#define INKLOOP_CHANGE_BOUND_H

#include "near_flow.h"

/* Memory for the tile of one thread, and the data read for it. */
typedef struct {
    NearRules rules;
    NearMaps maps; /* without steps there are no bounds */
    bool is_known; /* rows were read for `tile`, and nothing has changed since */
    Tile tile;
    ptrdiff_t top, bottom; /* rows of the maps that were read, bottom excluded */
    double cost_slope;     /* largest cost of a metre on any cell */
    double chance_slope;   /* largest cost of a metre on any cell through its uncertainty */
    double height_most;    /* largest distance from the reference of cells that changes can reach [m] */
    /* Maps of the cells after the last step: error and height above the ceiling, as far as changes can reach; height
     * above the reference [m]; weight; 1 in the part, 0 outside; uncertainty, and cost [m]. */
    float *error, *above, *height, *weight, *inside, *chance, *cost;
    void *memory;
} ChangeBound;

/* False if there is no memory. Plans of few steps have no bounds: their changes are tried as quickly. */
bool bound_open(ChangeBound *bound, const PlanSurface *surface);
void bound_close(ChangeBound *bound);

/* Discards the data read: the surface may be another one. */
static inline void bound_renew(ChangeBound *bound) {
    bound->is_known = false;
}

/* Begins with the changes of cells of a tile. */
void bound_begin(ChangeBound *bound, const PlanSurface *surface, const Tile *tile);

/* Updates the data read after a change of the surface in a box of its maps. */
void bound_change(ChangeBound *bound, const PlanSurface *surface, const Box *changed);

/* Lower bound of the change of the objective, with the present sums; -infinity if there is none. The changes are on
 * cell (i, j) of the tile, or on it and one that touches it. */
double change_bound(ChangeBound *bound, const PlanSurface *surface, size_t i, size_t j, const Change *change,
                    size_t count, const Sums *sums);

#endif
