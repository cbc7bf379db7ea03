#include "inkloop_core.h"

#include <stdlib.h>
#include <string.h>

#include "error_diffusion.h"
#include "paper_search.h"
#include "plan_search.h"
#include "projected_gradient.h"
#include "stopwatch.h"

int32_t inkloop_core_interface(void) {
    return CORE_INTERFACE;
}

double inkloop_layer(size_t nx, size_t ny, const double *height, const int32_t *pattern, const Ink ink[2],
                     const double *factor, int32_t passes, const int32_t order[4], double *scratch, double *after) {
    const size_t bytes = nx * ny * sizeof(double);
    memcpy(after, height, bytes);
    if (passes == 1)
        return deposit_pass(height, after, nx, ny, pattern, ink, factor, COLOUR_ALL);
    double lost = 0.0;
    for (int pass = 0; pass < 4; pass++) {
        memcpy(scratch, after, bytes);
        lost += deposit_pass(scratch, after, nx, ny, pattern, ink, factor, order[pass]);
    }
    return lost;
}

int32_t inkloop_objective(const HorizonProblem *problem, const int32_t *plan, Objective *value) {
    PlanSurface surface;
    if (!surface_open(&surface, problem, plan))
        return CORE_NO_MEMORY;
    *value = surface_objective(&surface);
    surface_close(&surface);
    return CORE_DONE;
}

static void finish(PlanSurface *surface, int32_t *plan, SearchReport *report) {
    surface_evaluate(surface);
    report->objective = surface_objective(surface);
    surface_plan(surface, plan);
    surface_close(surface);
}

int32_t inkloop_search(const HorizonProblem *problem, const SearchOptions *options, int32_t *plan,
                       SearchReport *report) {
    PlanSurface surface;
    *report = (SearchReport){0};
    const double began = stopwatch_seconds();
    if (!surface_open(&surface, problem, plan))
        return CORE_NO_MEMORY;
    const double evaluation = stopwatch_seconds() - began; /* the one at the end takes as long */
    const int32_t status = plan_search(&surface, options, began + options->seconds_max - evaluation, report);
    finish(&surface, plan, report);
    return status;
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
    finish(&surface, plan, report);
    return status;
}

int32_t inkloop_relax(const HorizonProblem *problem, const RelaxationOptions *options, double *droplets,
                      RelaxationReport *report) {
    RelaxedSurface surface;
    *report = (RelaxationReport){0};
    if (!relaxed_open(&surface, problem))
        return CORE_NO_MEMORY;
    const int32_t status = projected_gradient(&surface, options, droplets, report);
    relaxed_close(&surface);
    return status;
}

int32_t inkloop_relaxed_gradient(const HorizonProblem *problem, const double *droplets, double smoothing, double *value,
                                 double *gradient) {
    RelaxedSurface surface;
    if (!relaxed_open(&surface, problem))
        return CORE_NO_MEMORY;
    *value = relaxed_value(&surface, droplets, smoothing);
    relaxed_gradient(&surface, droplets, smoothing, gradient);
    relaxed_close(&surface);
    return CORE_DONE;
}

int32_t inkloop_diffuse(const HorizonProblem *problem, const double *droplets, int32_t *plan) {
    return diffuse_droplets(problem, droplets, plan);
}
