/* The layer problem of the model predictive controller: relaxed, rounded, repaired, and compared.
 *
 * The relaxed problem is solved and rounded by ordered error diffusion; that start, the rest of the last plan, full
 * layers and none are repaired by flips, swaps and shifts, and the best result is taken. It is compared with printing
 * nothing: without that a small alpha trades height for evenness for ever. Dead cells are left out, but for a layer now
 * and then in which they are tried again. The same answers as LayerMpc in Python with relaxation = "gradient". */
#ifndef INKLOOP_LAYER_PLANNER_H
#define INKLOOP_LAYER_PLANNER_H

#include "layer_problem.h"

/* In the order of PlanStatus in layer_plan.py. */
enum { PLAN_REPAIRED = 1, PLAN_BUDGET = 2, PLAN_TIME_LIMIT = 3, PLAN_FALLBACK = 5, PLAN_DONE = 7 };

typedef struct {
    int32_t status; /* PLAN_... */
    int64_t sweeps; /* of all repairs together */
    Objective objective;
} PlanReport;

/* The best plan found for the layers that follow layer number `layer`, whose surface is `estimate`; PLAN_DONE if that
 * is to print nothing. colours: for 4 passes, of each layer of the horizon in the order jetted. last: the last plan, or
 * zeros; plan: horizon * nx * ny, 0 nothing, 1 + (drops - 1) * inks + index of the ink. CORE_DONE or CORE_NO_MEMORY. */
int32_t plan_layers(const PlannerOptions *options, int32_t colours[HORIZON_MAX][4], const SurfaceEstimate *estimate,
                    int32_t layer, const int32_t *last, int32_t *plan, PlanReport *report);

#endif
