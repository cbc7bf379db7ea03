#include "inkloop_core.h"

#include <math.h>
#include <stdlib.h>

#include "error_diffusion.h"
#include "horizon_solver.h"
#include "layer_surface.h"
#include "observer.h"
#include "paper_search.h"
#include "step_outputs.h"

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
    const size_t places = problem->layers * problem->nx * problem->ny;
    size_t *order = malloc(2 * places * sizeof(size_t));
    Window window;
    int32_t status = CORE_NO_MEMORY;
    if (window_open(&window, &surface) && order)
        status = paper_search(&surface, (size_t)batch, iterations_max, seed, order, order + places, &window, report);
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

int32_t inkloop_diffuse(const HorizonProblem *problem, const double *droplets, int32_t *plan) {
    return diffuse_droplets(problem, 1, droplets, INFINITY, plan);
}

void inkloop_finish(int32_t finish, Finish *chosen) {
    *chosen = finish_of(finish);
}

size_t inkloop_variables(void) {
    return sizeof(LayerControllerVariables) / sizeof(void *);
}

size_t inkloop_estimate_size(size_t cells) {
    return estimate_size(cells);
}

size_t inkloop_knowledge_size(void) {
    return sizeof(Knowledge);
}

int32_t inkloop_estimate_first(const LayerStep *step, int32_t layer, const double *measured, const uint8_t *valid,
                               void *estimate) {
    const EstimatorOptions options = estimator_options(step);
    SurfaceEstimate first = estimate_in(estimate, cells_of(step));
    return estimate_first(&options, layer, measured, valid, &first) ? CORE_DONE : CORE_NO_SCAN;
}

int32_t inkloop_estimate_next(const LayerStep *step, const void *before, const int32_t *pattern, const double *factor,
                              int32_t number, int32_t is_unknown, const double *measured, const uint8_t *valid,
                              void *after) {
    const EstimatorOptions options = estimator_options(step);
    const SurfaceEstimate known = estimate_in((void *)before, cells_of(step));
    SurfaceEstimate next = estimate_in(after, cells_of(step));
    int32_t order[4];
    layer_colours(step, number, order);
    const JettedLayer layer = {.nx = options.nx,
                               .ny = options.ny,
                               .pattern = pattern,
                               .factor = factor,
                               .passes = *step->values->passes,
                               .order = order,
                               .threads = (size_t)step->threads};
    const bool is_done = estimate_next(&options, &known, &layer, number, is_unknown != 0, measured, valid, &next);
    return is_done ? CORE_DONE : CORE_NO_MEMORY;
}

void inkloop_estimate_figures(const LayerStep *step, void *estimate, EstimateFigures *figures, uint8_t *dead) {
    const EstimatorOptions options = estimator_options(step);
    const SurfaceEstimate known = estimate_in(estimate, cells_of(step));
    *figures = estimate_figures(&options, &known);
    mark_dead(&known, cells_of(step), dead);
}

void inkloop_trust_again(void *estimate, size_t cells) {
    SurfaceEstimate known = estimate_in(estimate, cells);
    trust_again(&known, cells);
}

size_t inkloop_state_head_size(void) {
    return sizeof(StateHead);
}

size_t inkloop_state_size(size_t cells, size_t layers) {
    return state_size(cells, layers);
}

size_t inkloop_state_layers(const LayerStep *step, const void *state, size_t size) {
    return state_layers(step, state, size);
}

void inkloop_state_start(const LayerStep *step, size_t layers, int32_t layers_printed, void *state) {
    state_start(step, layers, layers_printed, state);
}

void inkloop_state_plan(const void *state, PlanFigures *figures) {
    *figures = ((const StateHead *)state)->plan;
}

int32_t inkloop_step_is_due(const LayerStep *step, const void *state) {
    return step_is_due(step, state);
}

int32_t inkloop_step_begin(const LayerStep *step, const void *before, void *after) {
    return step_begin(step, before, after);
}

void inkloop_step_take(const LayerStep *step, const void *before, const int32_t *plan, size_t layers,
                       const PlanFigures *figures, void *after) {
    step_take(step, before, plan, layers, figures, after);
}

void inkloop_step_outputs(const LayerStep *step, const void *state) {
    step_outputs(step, state);
}

void inkloop_layer_problem(const LayerStep *step, const SurfaceToPlan *surface, int32_t layer, const ProblemMaps *maps,
                           HorizonProblem *problem) {
    *problem = layer_problem(step, surface, layer, maps);
}

int32_t inkloop_plan(const LayerStep *step, int32_t layer, const HorizonProblem *problem, int32_t relaxation,
                     const double *relaxed, const int32_t *last, size_t last_layers, double seconds_max,
                     DeviceSearch *device, AfterSweep *after_sweep, int32_t *plan, PlanReport *report) {
    PlanWork work = plan_work(step, layer);
    work.relaxation = relaxation;
    work.relaxed = relaxed;
    work.last = last;
    work.last_layers = last_layers;
    work.seconds_max = seconds_max;
    work.device = device;
    work.after_sweep = after_sweep;
    return plan_shortest(problem, &work, plan, report);
}

void inkloop_pattern(const int32_t *layer, size_t cells, int32_t inks, int32_t *pattern, int32_t *drop_level) {
    for (size_t cell = 0; cell < cells; cell++) {
        pattern[cell] = material_of(layer[cell], inks);
        drop_level[cell] = drops_of(layer[cell], inks);
    }
}
