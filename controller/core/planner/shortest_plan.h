/* The fewest layers that come near enough to the target, and the horizon and the worth of a layer that a user chooses.
 *
 * A receding horizon postpones its last full layers as long as anything is gained below them: the print ends with many
 * nearly empty layers. So a layer has a worth: each layer of a plan must lower the objective by that much, or the plan
 * for one layer less is taken. */
#ifndef INKLOOP_SHORTEST_PLAN_H
#define INKLOOP_SHORTEST_PLAN_H

#include "horizon_planner.h"

/* In the order of Finish in variables.toml of LayerController. */
enum { FINISH_EVEN = 1, FINISH_FAST = 2 };

/* foreign_horizon: horizon on plants that the model does not describe (surface_estimate.h); layer_worth: least gain by
 * a layer, as a share of the height of a full layer of the smallest drops. */
typedef struct {
    int32_t horizon, foreign_horizon;
    double layer_worth;
} Finish;

/* The horizons and the worth of a layer for a FINISH_.... */
Finish finish_of(int32_t finish);

/* The best plan for the whole horizon, then for one layer less, and so on, as long as the objective rises by less than
 * the worth of the layer; the layers left out are empty. PLAN_DONE if printing nothing is as good in this sense. The
 * plan has layers * nx * ny values. CORE_DONE or CORE_NO_MEMORY. */
int32_t plan_shortest(const HorizonProblem *problem, const PlanWork *work, int32_t *plan, PlanReport *report);

#endif
