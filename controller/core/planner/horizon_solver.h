/* Operations on a layer problem. Each call allocates its memory and releases it, but for a surface that it is given. */
#ifndef INKLOOP_HORIZON_SOLVER_H
#define INKLOOP_HORIZON_SOLVER_H

#include "plan_surface.h"

/* Objective of a plan. CORE_DONE, CORE_NO_MEMORY, or CORE_TIME where `ends_at` by the stopwatch came first. */
int32_t plan_objective(const HorizonProblem *problem, const int32_t *plan, double ends_at, int32_t threads,
                       Objective *value);

/* Improves a plan by annealing, if requested, and moves; see inkloop_search. Where the time ends before the plan given
 * is evaluated, it stays, CORE_TIME is returned, and the value of the objective is infinite. */
int32_t improve_plan(const HorizonProblem *problem, const SearchOptions *options, int32_t *plan, SearchReport *report);

/* The same on a surface of the problem that is open; it becomes that of any plan. */
int32_t improve_plan_on(PlanSurface *surface, const SearchOptions *options, int32_t *plan, SearchReport *report);

/* Objective of another plan on a surface of the problem that is open; false if `ends_at` by the stopwatch came first.
 */
bool plan_objective_on(PlanSurface *surface, const int32_t *plan, double ends_at, Objective *value);

/* Moves relaxed droplets to a lower smoothed objective; see inkloop_relax. */
int32_t relax_droplets(const HorizonProblem *problem, const RelaxationOptions *options, double *droplets,
                       RelaxationReport *report);

#endif
