#include "inkloop_core.h"

#include <stdlib.h>
#include <string.h>

#include "annealing.h"
#include "flip_search.h"
#include "paper_search.h"

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

int32_t inkloop_objective(const LayerProblem *problem, const int32_t *pattern, double *value) {
    LayerSurface surface;
    if (!surface_open(&surface, problem, pattern))
        return CORE_NO_MEMORY;
    *value = objective(&surface.sums, &surface.weighting);
    surface_close(&surface);
    return CORE_DONE;
}

static void finish(LayerSurface *surface, const LayerProblem *problem, int32_t *pattern, SearchReport *report) {
    report->incremental = objective(&surface->sums, &surface->weighting);
    surface_evaluate(surface, problem);
    report->objective = objective(&surface->sums, &surface->weighting);
    surface_pattern(surface, problem, pattern);
    surface_close(surface);
}

int32_t inkloop_search(const LayerProblem *problem, int32_t *pattern, int64_t annealing_sweeps, int64_t sweeps_max,
                       uint64_t seed, SearchReport *report) {
    LayerSurface surface;
    *report = (SearchReport){0};
    if (!surface_open(&surface, problem, pattern))
        return CORE_NO_MEMORY;
    anneal(&surface, annealing_sweeps, seed, report);
    const int32_t status = flip_search(&surface, report->sweeps + sweeps_max, report);
    finish(&surface, problem, pattern, report);
    return status;
}

int32_t inkloop_paper_search(const LayerProblem *problem, int32_t *pattern, int64_t batch, int64_t iterations_max,
                             uint64_t seed, SearchReport *report) {
    LayerSurface surface;
    *report = (SearchReport){0};
    if (!surface_open(&surface, problem, pattern))
        return CORE_NO_MEMORY;
    const size_t cells = problem->nx * problem->ny;
    size_t *order = malloc(2 * cells * sizeof(size_t));
    int32_t status = CORE_NO_MEMORY;
    if (order)
        status = paper_search(&surface, (size_t)batch, iterations_max, seed, order, order + cells, report);
    free(order);
    finish(&surface, problem, pattern, report);
    return status;
}
