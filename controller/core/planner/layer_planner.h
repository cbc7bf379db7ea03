/* The layers after a scan: their decision problem (layer_problem.h) and the best plan found (shortest_plan.h). */
#ifndef INKLOOP_LAYER_PLANNER_H
#define INKLOOP_LAYER_PLANNER_H

#include "horizon_planner.h"
#include "layer_problem.h"

/* The best plan found for the layers that follow layer number `layer`, whose surface is `estimate`; PLAN_DONE if that
 * is to print nothing. colours: for 4 passes, of each layer of the horizon in the order jetted. last: the last plan, or
 * zeros; plan: horizon * nx * ny, 0 nothing, 1 + (drops - 1) * inks + index of the ink. CORE_DONE or CORE_NO_MEMORY. */
int32_t plan_layers(const PlannerOptions *options, int32_t colours[HORIZON_MAX][4], const SurfaceEstimate *estimate,
                    const EstimateFigures *figures, int32_t layer, const int32_t *last, int32_t *plan,
                    PlanReport *report);

#endif
