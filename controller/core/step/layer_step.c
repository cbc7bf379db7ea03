#include "layer_step.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "observer.h"
#include "shortest_plan.h"
#include "step_problem.h"
#include "stopwatch.h"

static bool is_looked_at(const LayerStep *step, const void *state) {
    return *step->values->looked_at && is_stopped(step, state);
}

/* Whether the last scan is of the layer commanded last, and has not been answered. After the last layer there is no new
 * scan. */
static bool is_new(const LayerStep *step, const StateHead *head, bool looked_at) {
    const int64_t scanned = *step->values->layers_scanned;
    return scanned == *step->values->layers_printed && scanned == head->layer_command &&
           (scanned > head->answered || looked_at);
}

bool step_is_due(const LayerStep *step, const void *state) {
    const bool looked_at = is_looked_at(step, state);
    return looked_at || is_new(step, state, looked_at);
}

/* Whether each droplet of a layer is a single drop: then the layer is its own pattern. */
static bool has_single_drops(const int32_t *plan, size_t cells, int32_t inks) {
    for (size_t cell = 0; cell < cells; cell++)
        if (plan[cell] > inks)
            return false;
    return true;
}

/* Estimate after the scan of the layer that the state before has planned. */
static int32_t estimate_layer(const LayerStep *step, const void *before, SurfaceEstimate *after) {
    const LayerControllerVariables *v = step->values;
    const EstimatorOptions options = estimator_options(step);
    const SurfaceEstimate known = known_estimate(before);
    const int32_t *plan = last_plan(before);
    const size_t cells = cells_of(step);
    const bool is_grey = !has_single_drops(plan, cells, *v->inks);
    double *factor = is_grey ? malloc(cells * (sizeof(double) + sizeof(int32_t))) : NULL;
    int32_t *pattern = factor ? (int32_t *)(factor + cells) : NULL, order[4];
    if (is_grey && !factor)
        return CORE_NO_MEMORY;
    for (size_t cell = 0; is_grey && cell < cells; cell++) {
        pattern[cell] = material_of(plan[cell], *v->inks);
        factor[cell] = drops_of(plan[cell], *v->inks);
    }
    layer_colours(step, *v->layers_scanned, order);
    const JettedLayer layer = {.nx = options.nx,
                               .ny = options.ny,
                               .pattern = is_grey ? pattern : plan,
                               .factor = factor,
                               .passes = *v->passes,
                               .order = order,
                               .threads = (size_t)step->threads};
    const bool is_done = estimate_next(&options, &known, &layer, *v->layers_scanned, *v->layer_unknown,
                                       v->measured_height, (const uint8_t *)v->valid, after);
    free(factor);
    return is_done ? CORE_DONE : CORE_NO_MEMORY;
}

static int32_t estimate_scan(const LayerStep *step, const void *before, SurfaceEstimate *after) {
    const LayerControllerVariables *v = step->values;
    const EstimatorOptions options = estimator_options(step);
    if (((const StateHead *)before)->estimated != NO_SCAN)
        return estimate_layer(step, before, after);
    const uint8_t *valid = (const uint8_t *)v->valid;
    return estimate_first(&options, *v->layers_scanned, v->measured_height, valid, after) ? CORE_DONE : CORE_NO_SCAN;
}

int32_t step_begin(const LayerStep *step, const void *before, void *after) {
    const bool looked_at = is_looked_at(step, before), is_asked = is_new(step, before, looked_at);
    const size_t cells = cells_of(step), size = estimate_size(cells);
    StateHead *head = after;
    *head = *(const StateHead *)before;
    SurfaceEstimate estimate = state_estimate(after);
    memcpy(state_plan(after), last_plan(before), (size_t)head->layers * cells * sizeof(int32_t));
    state_plan(after)[-1] = state_plan(after)[-2] = 0; /* nothing may lie between the maps and the plan */
    if (head->estimated < *step->values->layers_scanned && !looked_at) {
        const int32_t status = estimate_scan(step, before, &estimate);
        if (status != CORE_DONE)
            return status;
        head->estimated = *step->values->layers_scanned;
    } else
        memcpy(head + 1, (const StateHead *)before + 1, size); /* where planning has failed, it is begun again */
    if (looked_at) {
        trust_again(&estimate, cells);
        head->answered--;
    }
    if (is_asked && !is_stopped(step, after))
        return STEP_PLAN;
    head->answered = is_asked ? head->estimated : head->answered;
    return STEP_ANSWERED;
}

void step_take(const LayerStep *step, const void *before, const int32_t *plan, size_t layers,
               const PlanFigures *figures, void *after) {
    StateHead *head = after;
    const size_t cells = cells_of(step);
    if (after != before)
        memcpy(after, before, sizeof *head + estimate_size(cells));
    head->layers = layers;
    head->plan = *figures;
    head->plan.seconds = *step->values->is_timed ? figures->seconds : 0.0;
    head->answered = head->estimated;
    head->layer_command += figures->status == PLAN_DONE ? 0 : 1;
    if (plan != state_plan(after))
        memcpy(state_plan(after), plan, layers * cells * sizeof(int32_t));
}

int32_t step_plan(const LayerStep *step, const void *before, void *after, double began) {
    const StateHead *head = after;
    const size_t cells = cells_of(step), layers = (size_t)head->layers;
    const int32_t scan = (int32_t)head->estimated;
    const EstimatorOptions options = estimator_options(step);
    const SurfaceEstimate estimate = state_estimate(after);
    const EstimateFigures figures = estimate_figures(&options, &estimate);
    double *memory = malloc(cells * (2 * sizeof(double) + layers * sizeof(uint16_t) + 1));
    if (!memory)
        return CORE_NO_MEMORY;
    const ProblemMaps maps = {memory, memory + cells, (uint16_t *)(memory + 2 * cells)};
    uint8_t *dead = (uint8_t *)(maps.choices + layers * cells);
    mark_dead(&estimate, cells, dead);
    const SurfaceToPlan surface = {.height = estimate.height,
                                   .variance = estimate.variance,
                                   .dead = dead,
                                   .capped = estimate.capped,
                                   .ink = {figures.ink[0], figures.ink[1]},
                                   .droplet_std = figures.droplet_std,
                                   .is_foreign = figures.is_foreign != 0};
    const HorizonProblem problem = layer_problem(step, &surface, scan, &maps);
    PlanWork work = plan_work(step, scan);
    work.last = last_plan(before);
    work.last_layers = layers;
    work.seconds_max = fmax(0.0, work.seconds_max - (stopwatch_seconds() - began));
    int32_t *plan = state_plan(after);
    memset(plan + problem.layers * cells, 0, (layers - problem.layers) * cells * sizeof(int32_t));
    PlanReport report;
    const int32_t status = plan_shortest(&problem, &work, plan, &report);
    free(memory);
    if (status != CORE_DONE)
        return status;
    const PlanFigures found = {
        report.status, report.left_out, report.sweeps, report.objective, NAN, 1.0, stopwatch_seconds() - began};
    step_take(step, after, plan, layers, &found, after);
    return CORE_DONE;
}
