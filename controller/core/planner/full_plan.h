/* The fullest plan, droplets wherever allowed in every layer: best far below the target; and a test of that.
 *
 * One droplet more, or a larger one, lowers no cell of any later surface, as long as the slopes of its flow add up to 1
 * at most: a cell never loses more than it gains by a higher neighbour. So no plan ends higher anywhere. Below the
 * target the mean error falls as fast as a cell rises, and the standard deviation is convex: where the error weighs
 * more on every cell than its height above the mean does, no lower surface has a lower objective. */
#ifndef INKLOOP_FULL_PLAN_H
#define INKLOOP_FULL_PLAN_H

#include "plan_surface.h"

/* One of the largest droplets allowed wherever one is allowed. False if a cell may choose between kinds of which none
 * is the largest in every part, or if droplets may flow so freely that more of them can lower a cell. */
bool fullest_plan(const HorizonProblem *problem, int32_t threads, int32_t *plan);

/* Whether no plan is better than this fullest one, by its surfaces. */
bool is_fullest_best(const PlanSurface *surface);

#endif
