/* The layer problem of the model predictive controller for one horizon, solved: relaxed, rounded, repaired, compared.
 *
 * The relaxed problem is solved and rounded by ordered error diffusion; that start, the rest of the last plan, full
 * layers and none are repaired by flips, swaps and shifts: the best of them, or where annealing is worth its time all
 * of them and once more the best one, annealed. The best result is taken. It is compared with printing nothing:
 * otherwise a small alpha would trade height for evenness forever. Where full layers are proven best (full_plan.h)
 * there is no search.
 *
 * A time limit leaves out stages, and cuts them off; nothing, and the missing height rounded in equal shares, are
 * always compared: that is the least that a plan takes. */
#ifndef INKLOOP_HORIZON_PLANNER_H
#define INKLOOP_HORIZON_PLANNER_H

#include "plan_work.h"

/* In the order of PlanStatus in layer_plan.py. */
enum { PLAN_REPAIRED = 1, PLAN_BUDGET = 2, PLAN_TIME_LIMIT = 3, PLAN_STOPPED = 4, PLAN_FALLBACK = 5, PLAN_DONE = 7 };

typedef struct {
    int32_t status; /* PLAN_... */
    int32_t start;  /* START_...: what the plan was made from */
    int32_t is_annealed;
    int32_t left_out;             /* LEFT_... */
    int64_t sweeps;               /* of all repairs together */
    Objective objective, nothing; /* of the plan; of printing nothing */
    double evaluation;            /* what that of a plan took [s] */
    double seconds[PHASES];
} PlanReport;

/* The best plan found (layers * nx * ny); PLAN_DONE if that is to print nothing. CORE_DONE or CORE_NO_MEMORY; with a
 * longer plan also CORE_TIME, without a plan where there was no time for a first one. */
int32_t plan_horizon(const HorizonProblem *problem, const PlanWork *work, int32_t *plan, PlanReport *report);

#endif
