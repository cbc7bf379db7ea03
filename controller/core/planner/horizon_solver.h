/* Operations on a layer problem. Each call allocates and releases its own memory; a surface passed in stays open. */
#ifndef INKLOOP_HORIZON_SOLVER_H
#define INKLOOP_HORIZON_SOLVER_H

#include "plan_surface.h"

/* Objective of a plan. CORE_DONE, CORE_NO_MEMORY, or CORE_TIME where `ends_at` by the stopwatch came first. */
int32_t plan_objective(const HorizonProblem *problem, const int32_t *plan, double ends_at, int32_t threads,
                       Objective *value);

/* Improves a plan by annealing, if requested, and moves; see inkloop_search. If the time ends before the start plan is
 * evaluated, that plan is kept, CORE_TIME is returned, and the objective is infinite. */
int32_t improve_plan(const HorizonProblem *problem, const SearchOptions *options, int32_t *plan, SearchReport *report);

/* The same on an open surface of the problem, which may hold any plan. */
int32_t improve_plan_on(PlanSurface *surface, const SearchOptions *options, int32_t *plan, SearchReport *report);

/* Objective of another plan on an open surface of the problem; false if `ends_at` by the stopwatch came first. */
bool plan_objective_on(PlanSurface *surface, const int32_t *plan, double ends_at, Objective *value);

/* Moves relaxed droplets to a lower smoothed objective; see inkloop_relax. */
int32_t relax_droplets(const HorizonProblem *problem, const RelaxationOptions *options, double *droplets,
                       RelaxationReport *report);

#endif
