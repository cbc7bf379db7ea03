#include "layer_planner.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "shortest_plan.h"
#include "stopwatch.h"

int32_t plan_layers(const PlannerOptions *options, int32_t colours[HORIZON_MAX][4], const SurfaceEstimate *estimate,
                    const EstimateFigures *figures, int32_t layer, const int32_t *last, int32_t *plan,
                    PlanReport *report) {
    const size_t cells = options->nx * options->ny;
    const double began = stopwatch_seconds();
    double *memory = malloc(cells * (2 * sizeof(double) + options->horizon * sizeof(uint16_t)));
    if (!memory)
        return CORE_NO_MEMORY;
    const ProblemMaps maps = {memory, memory + cells, (uint16_t *)(memory + 2 * cells)};
    const HorizonProblem problem = layer_problem(options, colours, estimate, figures, layer, &maps);
    const PlanWork work = {.last = last,
                           .last_layers = options->horizon,
                           .layer_worth = options->layer_worth,
                           .sweeps = options->sweeps,
                           .annealing_sweeps = options->annealing_sweeps,
                           .iterations = options->iterations,
                           .seed = ((uint64_t)options->seed << 32) + (uint64_t)layer,
                           .seconds_max = fmax(0.0, options->seconds_max - (stopwatch_seconds() - began)),
                           .threads = 1};
    memset(plan + problem.layers * cells, 0, (options->horizon - problem.layers) * cells * sizeof(int32_t));
    const int32_t status = plan_shortest(&problem, &work, plan, report);
    free(memory);
    return status;
}
