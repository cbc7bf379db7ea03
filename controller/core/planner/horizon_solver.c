#include "horizon_solver.h"

#include <math.h>

#include "plan_search.h"
#include "projected_gradient.h"
#include "stopwatch.h"

int32_t plan_objective(const HorizonProblem *problem, const int32_t *plan, double ends_at, int32_t threads,
                       Objective *value) {
    PlanSurface surface;
    bool is_evaluated;
    if (!surface_open_until(&surface, problem, plan, ends_at, threads, &is_evaluated))
        return CORE_NO_MEMORY;
    if (is_evaluated)
        *value = surface_objective(&surface);
    surface_close(&surface);
    return is_evaluated ? CORE_DONE : CORE_TIME;
}

/* Improves the plan of an evaluated surface; the evaluation began at `began`. */
static int32_t improve(PlanSurface *surface, const SearchOptions *options, double began, int32_t *plan,
                       SearchReport *report) {
    const double evaluation = stopwatch_seconds() - began; /* time reserved for the evaluation at the end */
    const int32_t status = plan_search(surface, options, began + options->seconds_max - evaluation, report);
    report->objective = surface_objective(surface);
    surface_plan(surface, plan);
    return status;
}

static const SearchReport UNKNOWN = {.objective = {.value = INFINITY}};

int32_t improve_plan(const HorizonProblem *problem, const SearchOptions *options, int32_t *plan, SearchReport *report) {
    PlanSurface surface;
    bool is_evaluated;
    *report = UNKNOWN;
    const double began = stopwatch_seconds();
    if (!surface_open_until(&surface, problem, plan, began + options->seconds_max, options->threads, &is_evaluated))
        return CORE_NO_MEMORY;
    const int32_t status = is_evaluated ? improve(&surface, options, began, plan, report) : CORE_TIME;
    surface_close(&surface);
    return status;
}

int32_t improve_plan_on(PlanSurface *surface, const SearchOptions *options, int32_t *plan, SearchReport *report) {
    *report = UNKNOWN;
    const double began = stopwatch_seconds();
    /* a time limit needs the duration of an evaluation */
    if (!isinf(options->seconds_max) || !surface_holds(surface, plan)) {
        surface_set_plan(surface, plan);
        if (!surface_evaluate_until(surface, began + options->seconds_max))
            return CORE_TIME;
    }
    return improve(surface, options, began, plan, report);
}

bool plan_objective_on(PlanSurface *surface, const int32_t *plan, double ends_at, Objective *value) {
    surface_set_plan(surface, plan);
    const bool is_evaluated = surface_evaluate_until(surface, ends_at);
    if (is_evaluated)
        *value = surface_objective(surface);
    return is_evaluated;
}

int32_t relax_droplets(const HorizonProblem *problem, const RelaxationOptions *options, double *droplets,
                       RelaxationReport *report) {
    RelaxedSurface surface;
    RelaxationOptions rest = *options;
    const double began = stopwatch_seconds();
    *report = (RelaxationReport){0};
    if (!relaxed_open(&surface, problem))
        return CORE_NO_MEMORY;
    rest.seconds_max -= stopwatch_seconds() - began;
    surface.threads = (size_t)options->threads;
    const int32_t status = projected_gradient(&surface, &rest, droplets, report);
    relaxed_close(&surface);
    return status;
}
