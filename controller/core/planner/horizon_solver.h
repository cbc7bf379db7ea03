/* Operations on a layer problem. Each call is complete in itself: it allocates its memory and releases it. */
#ifndef INKLOOP_HORIZON_SOLVER_H
#define INKLOOP_HORIZON_SOLVER_H

#include "horizon_problem.h"

/* Objective of a plan. CORE_DONE, CORE_NO_MEMORY, or CORE_TIME where `ends_at` by the stopwatch came first. */
int32_t plan_objective(const HorizonProblem *problem, const int32_t *plan, double ends_at, int32_t threads,
                       Objective *value);

/* Improves a plan by annealing, if requested, and moves; see inkloop_search. Where the time ends before the plan given
 * is evaluated, it stays, CORE_TIME is returned, and the value of the objective is infinite. */
int32_t improve_plan(const HorizonProblem *problem, const SearchOptions *options, int32_t *plan, SearchReport *report);

/* Moves relaxed droplets to a lower smoothed objective; see inkloop_relax. */
int32_t relax_droplets(const HorizonProblem *problem, const RelaxationOptions *options, double *droplets,
                       RelaxationReport *report);

#endif
