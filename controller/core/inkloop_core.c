#include "inkloop_core.h"

#include <math.h>
#include <stdlib.h>

#include "error_diffusion.h"
#include "horizon_solver.h"
#include "layer_surface.h"
#include "paper_search.h"
#include "relaxed_surface.h"

int32_t inkloop_core_interface(void) {
    return CORE_INTERFACE;
}

double inkloop_layer(size_t nx, size_t ny, const double *height, const int32_t *pattern, const Ink ink[2],
                     const double *factor, int32_t passes, const int32_t order[4], double *scratch, double *after) {
    const JettedLayer layer = {nx, ny, pattern, factor, passes, order, 1};
    return layer_surface(&layer, height, ink, scratch, after);
}

int32_t inkloop_objective(const HorizonProblem *problem, const int32_t *plan, Objective *value) {
    return plan_objective(problem, plan, INFINITY, 1, value);
}

int32_t inkloop_search(const HorizonProblem *problem, const SearchOptions *options, int32_t *plan,
                       SearchReport *report) {
    const int32_t status = improve_plan(problem, options, plan, report);
    if (status != CORE_TIME || !isinf(report->objective.value))
        return status;
    const int32_t evaluated = plan_objective(problem, plan, INFINITY, options->threads, &report->objective);
    report->incremental = report->objective.value;
    return evaluated == CORE_DONE ? CORE_TIME : evaluated;
}

int32_t inkloop_paper_search(const HorizonProblem *problem, int32_t *plan, int64_t batch, int64_t iterations_max,
                             uint64_t seed, SearchReport *report) {
    PlanSurface surface;
    *report = (SearchReport){0};
    if (!surface_open(&surface, problem, plan))
        return CORE_NO_MEMORY;
    const size_t cells = problem->nx * problem->ny;
    size_t *order = malloc(2 * cells * sizeof(size_t));
    Window window;
    int32_t status = CORE_NO_MEMORY;
    if (window_open(&window, &surface) && order)
        status = paper_search(&surface, (size_t)batch, iterations_max, seed, order, order + cells, &window, report);
    report->incremental = objective(&surface.sums, &surface.weighting);
    window_close(&window);
    free(order);
    surface_evaluate(&surface);
    report->objective = surface_objective(&surface);
    surface_plan(&surface, plan);
    surface_close(&surface);
    return status;
}

int32_t inkloop_relax(const HorizonProblem *problem, const RelaxationOptions *options, double *droplets,
                      RelaxationReport *report) {
    return relax_droplets(problem, options, droplets, report);
}

int32_t inkloop_relaxed_gradient(const HorizonProblem *problem, const double *droplets, double smoothing, double *value,
                                 double *gradient) {
    RelaxedSurface surface;
    if (!relaxed_open(&surface, problem))
        return CORE_NO_MEMORY;
    (void)relaxed_value(&surface, droplets, smoothing, value);
    (void)relaxed_gradient(&surface, droplets, smoothing, gradient);
    relaxed_close(&surface);
    return CORE_DONE;
}

int32_t inkloop_diffuse(const HorizonProblem *problem, const double *droplets, int32_t *plan) {
    return diffuse_droplets(problem, droplets, INFINITY, plan);
}

void inkloop_ink_choices(const InkRegions *regions, size_t cells, const double *height, size_t layers,
                         int32_t *choices) {
    ink_choices(regions, cells, height, layers, choices);
}

int32_t inkloop_plan(const HorizonProblem *problem, const PlanWork *work, int32_t *plan, PlanReport *report) {
    return plan_shortest(problem, work, plan, report);
}

void inkloop_finish(int32_t finish, Finish *chosen) {
    *chosen = finish_of(finish);
}

size_t inkloop_knowledge_size(void) {
    return sizeof(Knowledge);
}

int32_t inkloop_estimate_first(const EstimatorOptions *options, int32_t layer, const double *measured,
                               const uint8_t *valid, SurfaceEstimate *estimate) {
    return estimate_first(options, layer, measured, valid, estimate) ? CORE_DONE : CORE_NO_MEMORY;
}

int32_t inkloop_estimate_next(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                              int32_t number, int32_t is_unknown, const double *measured, const uint8_t *valid,
                              SurfaceEstimate *after) {
    const bool is_done = estimate_next(options, before, layer, number, is_unknown != 0, measured, valid, after);
    return is_done ? CORE_DONE : CORE_NO_MEMORY;
}

void inkloop_estimate_figures(const EstimatorOptions *options, const SurfaceEstimate *estimate,
                              EstimateFigures *figures) {
    *figures = estimate_figures(options, estimate);
}

void inkloop_trust_again(SurfaceEstimate *estimate, size_t cells) {
    trust_again(estimate, cells);
}
