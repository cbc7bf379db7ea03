/* The layer problem of the model predictive controller for one horizon, solved: relaxed, rounded, repaired, compared.
 *
 * The relaxed problem is solved and rounded by ordered error diffusion. The starts are that plan, the rest of the last
 * plan, full layers and none. The best start is repaired by flips, swaps and shifts; where annealing is worth its time,
 * all starts are, and the best one once more after annealing. The best result is taken. It is compared with printing
 * nothing: otherwise a small alpha would trade height for evenness forever. Where full layers are proven best
 * (full_plan.h) there is no search.
 *
 * A time limit skips stages or cuts them off. Two plans are always compared: nothing, and the missing height rounded in
 * equal shares. */
#ifndef INKLOOP_HORIZON_PLANNER_H
#define INKLOOP_HORIZON_PLANNER_H

#include "plan_work.h"

/* In the order of PlanStatus in layer_plan.py. */
enum { PLAN_REPAIRED = 1, PLAN_BUDGET = 2, PLAN_TIME_LIMIT = 3, PLAN_STOPPED = 4, PLAN_FALLBACK = 5, PLAN_DONE = 7 };

typedef struct {
    int32_t status; /* PLAN_... */
    int32_t start;  /* START_...: origin of the plan */
    int32_t is_annealed;
    int32_t left_out;             /* LEFT_... */
    int64_t sweeps;               /* sweeps of all repairs together */
    Objective objective, nothing; /* objectives of the plan, and of printing nothing */
    double evaluation;            /* duration of an evaluation of a plan [s] */
    double seconds[PHASES];
} PlanReport;

/* The best plan found (layers * nx * ny); PLAN_DONE if that prints nothing. CORE_DONE or CORE_NO_MEMORY; with a longer
 * plan also CORE_TIME, without a plan, if there was no time for a first one. */
int32_t plan_horizon(const HorizonProblem *problem, const PlanWork *work, int32_t *plan, PlanReport *report);

#endif
