#include "shortest_plan.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "horizon_solver.h"
#include "layer_surface.h"
#include "plan_starts.h"
#include "stopwatch.h"

/* Share of the mean error that a full layer removes far from the target: more than nothing can make up for (by
 * trial). */
static const double FULL_LAYER = 0.75;

/* Horizon on plants whose droplets the model does not describe. A plan for more layers leaves holes for its last ones
 * to level, which only the model does. On such plants three layers end as even as five, or evener; of two, the change
 * from five ends rough under surface tension (by trial). */
enum { FOREIGN_HORIZON = 3 };

/* Minimum time left to try a shorter plan, in evaluations of a plan (assumed). */
static const double LEAST_TIME = 10.0;

typedef struct {
    const PlanWork *work;
    bool is_stopped; /* by after_sweep */
} Stop;

static int32_t after_sweep(void *caller, const SearchReport *so_far) {
    Stop *stop = caller;
    const int32_t answer = stop->work->after_sweep(stop->work->caller, so_far);
    stop->is_stopped = stop->is_stopped || answer != 0;
    return answer;
}

Finish finish_of(int32_t finish) {
    return finish == FINISH_FAST ? (Finish){4, FOREIGN_HORIZON, 0.007} : (Finish){5, FOREIGN_HORIZON, 0.0015};
}

/* Layers of a plan up to its last droplet. */
static size_t layers_used(const HorizonProblem *problem, const int32_t *plan) {
    const size_t cells = problem->nx * problem->ny;
    size_t place = problem->layers * cells;
    while (place > 0 && plan[place - 1] == 0)
        place--;
    return (place + cells - 1) / cells;
}

/* Ends the horizon with the last layer of the plan: an empty one would hide the uncertainty of the last droplets.
 * Without the time to evaluate that (CORE_TIME) the objective stays the one with the empty layers. */
static int32_t end_with_plan(HorizonProblem *problem, const PlanWork *work, const int32_t *plan, double ends_at,
                             Objective *value) {
    const size_t used = layers_used(problem, plan);
    const bool is_shorter = used < problem->layers;
    problem->layers = used;
    return is_shorter ? plan_objective(problem, plan, ends_at, work->threads, value) : CORE_DONE;
}

static double tallest_layer(const HorizonProblem *problem) {
    double tallest = 0.0;
    for (size_t kind = 0; kind < problem->kinds; kind++)
        tallest = fmax(tallest, full_layer_height(&problem->kind[kind]));
    return tallest;
}

static void add_work(PlanReport *report, const PlanReport *earlier) {
    report->left_out |= earlier->left_out;
    report->sweeps += earlier->sweeps;
    for (int phase = 0; phase < PHASES; phase++)
        report->seconds[phase] += earlier->seconds[phase];
}

/* A plan for the first layers of the problem (`fewer`) in `shorter`; one start is made from the `longer` one. False if
 * no such plan can be worth it, or if there is no time (CORE_TIME). */
static bool plan_fewer(const HorizonProblem *fewer, const PlanWork *work, double ends_at, int32_t *shorter,
                       PlanReport *report, int32_t *status) {
    Objective rest;
    squeeze_plan(fewer, work->threads, work->longer, shorter);
    *status = plan_objective(fewer, shorter, ends_at, work->threads, &rest);
    if (*status != CORE_DONE || rest.value - work->longer_value > FULL_LAYER * fewer->alpha * tallest_layer(fewer))
        return false;
    PlanWork left = *work;
    left.seconds_max = ends_at - stopwatch_seconds();
    *status = plan_horizon(fewer, &left, shorter, report);
    return *status == CORE_DONE;
}

/* Removes layers from the plan as long as that pays. */
static int32_t shorten(const HorizonProblem *problem, const PlanWork *work, double price, double ends_at, Stop *stop,
                       int32_t *plan, int32_t *shorter, PlanReport *report) {
    const size_t cells = problem->nx * problem->ny;
    HorizonProblem fewer = *problem;
    PlanWork rest = *work;
    rest.last = NULL;
    rest.longer = plan;
    rest.layer_price = price;
    rest.relaxation = work->relaxation == RELAX_GIVEN ? RELAX_HERE : work->relaxation;
    int32_t status = end_with_plan(&fewer, work, plan, ends_at, &report->objective);
    while (status == CORE_DONE && --fewer.layers > 0 && !stop->is_stopped) {
        PlanReport found;
        rest.longer_value = report->objective.value;
        if (ends_at - stopwatch_seconds() < LEAST_TIME * report->evaluation) {
            report->left_out |= LEFT_FEWER_LAYERS;
            break;
        }
        if (!plan_fewer(&fewer, &rest, ends_at, shorter, &found, &status))
            break;
        if (found.status == PLAN_DONE || found.objective.value > report->objective.value + price) {
            add_work(report, &found);
            break;
        }
        add_work(&found, report);
        *report = found;
        memset(plan, 0, problem->layers * cells * sizeof(int32_t));
        memcpy(plan, shorter, fewer.layers * cells * sizeof(int32_t));
        status = end_with_plan(&fewer, work, plan, ends_at, &report->objective);
    }
    report->left_out |= status == CORE_TIME ? LEFT_FEWER_LAYERS : 0;
    return status == CORE_TIME ? CORE_DONE : status;
}

int32_t plan_shortest(const HorizonProblem *problem, const PlanWork *work, int32_t *plan, PlanReport *report) {
    const size_t places = problem->layers * problem->nx * problem->ny;
    const double price = work->layer_worth * full_layer_height(&problem->kind[0]);
    const double ends_at = stopwatch_seconds() + work->seconds_max;
    Stop stop = {work, false};
    PlanWork watched = *work;
    if (work->after_sweep) {
        watched.after_sweep = after_sweep;
        watched.caller = &stop;
    }
    int32_t status = plan_horizon(problem, &watched, plan, report);
    if (status != CORE_DONE || report->status == PLAN_DONE || price == 0.0)
        return status;
    int32_t *other = calloc(places, sizeof(int32_t));
    const Objective nothing = report->nothing;
    if (!other)
        return CORE_NO_MEMORY;
    status = shorten(problem, &watched, price, ends_at, &stop, plan, other, report);
    const double gain = nothing.value - report->objective.value;
    if (status == CORE_DONE && gain <= (double)layers_used(problem, plan) * price) {
        memset(plan, 0, places * sizeof(int32_t));
        report->status = PLAN_DONE;
        report->start = START_NOTHING;
        report->is_annealed = 0;
        report->objective = nothing;
    }
    free(other);
    return status;
}
