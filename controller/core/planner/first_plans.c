#include "first_plans.h"

#include <math.h>
#include <string.h>

#include "error_diffusion.h"
#include "horizon_solver.h"
#include "plan_starts.h"
#include "plan_surface.h"
#include "stopwatch.h"

static const double RELAXATION_SHARE = 0.3; /* largest share of a time limit (assumed) */
/* copies of the plan and its first layer's surface, in times of an evaluation */
static const double ENDING = 1.0;
/* memory, one iteration and two values, in times of an evaluation (by trial) */
static const double LEAST_RELAXATION = 6.0;

double ending_at(const FirstPlans *first) {
    return first->ends_at - ENDING * first->evaluation;
}

double seconds_left(const FirstPlans *first) {
    return ending_at(first) - stopwatch_seconds();
}

static bool is_limited(const FirstPlans *first) {
    return !isinf(first->ends_at);
}

/* False if `ends_at` came before. */
static bool evaluate(FirstPlans *first, PlanSurface *surface, const int32_t *plan, double ends_at, Objective *value) {
    const double began = stopwatch_seconds();
    const bool is_evaluated = plan_objective_on(surface, plan, ends_at, value);
    first->evaluation = fmax(first->evaluation, stopwatch_seconds() - began);
    return is_evaluated;
}

static bool take(FirstPlans *first, PlanSurface *surface, int start, double ends_at) {
    first->is_there[start] = evaluate(first, surface, first->plan[start], ends_at, &first->value[start]);
    return first->is_there[start];
}

/* Evaluates one of the cheap plans, unless the time ends first. */
static bool take_start(FirstPlans *first, PlanSurface *surface, int start) {
    const bool is_taken = take(first, surface, start, ending_at(first));
    first->left_out |= is_taken ? 0 : LEFT_STARTS;
    return is_taken;
}

/* Whether there is time for one more cheap plan. */
static bool has_time(FirstPlans *first) {
    const bool found = seconds_left(first) >= first->evaluation;
    first->left_out |= found ? 0 : LEFT_STARTS;
    return found;
}

/* Whether droplets of any size help: one layer in one pass gains no more by them than by an even share (by trial). A
 * device repairs even shares in less time than their relaxation takes here. */
static bool can_relax(const FirstPlans *first) {
    return first->work->relaxation == RELAX_HERE && !first->work->device &&
           (first->problem->layers > 1 || first->problem->passes > 1);
}

static void set_droplets(FirstPlans *first) {
    if (first->work->relaxation == RELAX_GIVEN)
        memcpy(first->droplets, first->work->relaxed, first->places * sizeof(double));
    if (first->work->relaxation == RELAX_HERE)
        even_droplets(first->problem, first->work->threads, first->droplets);
}

static int32_t relax(FirstPlans *first) {
    const double began = stopwatch_seconds(), seconds = RELAXATION_SHARE * fmax(0.0, seconds_left(first));
    int32_t status = CORE_TIME;
    if (seconds >= LEAST_RELAXATION * first->evaluation) {
        const RelaxationOptions options = {first->work->iterations, seconds, first->work->threads};
        RelaxationReport report;
        status = relax_droplets(first->problem, &options, first->droplets, &report);
    }
    if (status == CORE_TIME)
        first->left_out |= LEFT_RELAXATION;
    first->seconds[PHASE_RELAXATION] = stopwatch_seconds() - began;
    return status;
}

/* Replaces the even shares by the rounded relaxed droplets, if the relaxation was completed or they are better. */
static int32_t take_relaxed(FirstPlans *first, PlanSurface *surface, double rounding) {
    const int32_t relaxed = relax(first);
    if (relaxed == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    if (seconds_left(first) < rounding + first->evaluation) {
        first->left_out |= LEFT_RELAXATION;
        return CORE_DONE;
    }
    const int32_t rounded =
        diffuse_droplets(first->problem, first->work->threads, first->droplets, ending_at(first), first->trial);
    Objective value;
    if (rounded == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    if (rounded == CORE_TIME || !evaluate(first, surface, first->trial, ending_at(first), &value)) {
        first->left_out |= LEFT_RELAXATION;
        return CORE_DONE;
    }
    if (relaxed == CORE_DONE || value.value < first->value[START_RELAXATION].value) {
        memcpy(first->plan[START_RELAXATION], first->trial, first->places * sizeof(int32_t));
        first->value[START_RELAXATION] = value;
    }
    return CORE_DONE;
}

/* Whether droplets of several sizes may fall on a cell. */
static bool has_sizes(const HorizonProblem *problem) {
    const size_t places = problem->kinds > 1 ? problem->layers * problem->nx * problem->ny : 0;
    for (size_t place = 0; place < places; place++)
        if (problem->choices[place] & (problem->choices[place] - 1))
            return true;
    return false;
}

/* The rest of the last plan, or of the plan for one layer more. A plan of several sizes of droplets is not postponed: a
 * repair would not leave that plan (by trial: mean absolute error of four sizes 0.22 um instead of 0.14). */
static void take_rest(FirstPlans *first, PlanSurface *surface) {
    const HorizonProblem *problem = first->problem;
    const PlanWork *work = first->work;
    const int32_t *of = work->longer ? work->longer : work->last;
    const size_t layers = work->longer ? problem->layers + 1 : work->last_layers;
    if (!of || !has_time(first))
        return;
    shift_plan(problem, work->threads, of, layers, first->plan[START_LAST_PLAN]);
    if (!take_start(first, surface, START_LAST_PLAN))
        return;
    if (layers == 1 || layers > problem->layers + 1 || (!work->longer && has_sizes(problem)) || !has_time(first))
        return;
    if (work->longer)
        squeeze_plan(problem, work->threads, of, first->trial);
    else
        postpone_plan(problem, work->threads, of, layers, first->trial);
    Objective value;
    if (!evaluate(first, surface, first->trial, ending_at(first), &value)) {
        first->left_out |= LEFT_STARTS;
        return;
    }
    if (value.value >= first->value[START_LAST_PLAN].value)
        return;
    memcpy(first->plan[START_LAST_PLAN], first->trial, first->places * sizeof(int32_t));
    first->value[START_LAST_PLAN] = value;
}

static void take_full_layers(FirstPlans *first, PlanSurface *surface) {
    if (!has_time(first))
        return;
    full_layers(first->problem, first->work->threads, first->plan[START_FULL_LAYERS]);
    (void)take_start(first, surface, START_FULL_LAYERS);
}

/* A plan that is sound for every problem: the rounded droplets, or full layers if there is no relaxation; and the
 * duration of the rounding [s]. */
static int32_t take_sound(FirstPlans *first, PlanSurface *surface, double *rounding) {
    const bool is_rounded = first->work->relaxation != RELAX_NOTHING;
    const double began = stopwatch_seconds();
    int32_t rounded = CORE_DONE;
    if (is_rounded)
        rounded = diffuse_droplets(first->problem, first->work->threads, first->droplets, first->first_ends_at,
                                   first->plan[START_RELAXATION]);
    else
        full_layers(first->problem, first->work->threads, first->plan[START_FULL_LAYERS]);
    if (rounded != CORE_DONE)
        return rounded;
    *rounding = stopwatch_seconds() - began;
    return take(first, surface, is_rounded ? START_RELAXATION : START_FULL_LAYERS, first->first_ends_at) ? CORE_DONE
                                                                                                         : CORE_TIME;
}

static bool has_last_plan(const FirstPlans *first) {
    const PlanWork *work = first->work;
    const size_t places = work->last ? work->last_layers * first->problem->nx * first->problem->ny : 0;
    for (size_t place = 0; place < places; place++)
        if (work->last[place] != 0)
            return true;
    return work->longer != NULL;
}

/* Replaces the diffused droplets of a single layer by dithered ones, if they are better. On nearly flat surfaces they
 * are, and so is their repair (by trial: by 2 to 4 % from 60 x 60 cells on); of several layers they never were. A last
 * plan is as good a start, and most prints of single layers have one: then dithering is not tried. */
static void take_dithered(FirstPlans *first, PlanSurface *surface) {
    const HorizonProblem *problem = first->problem;
    if (first->work->relaxation == RELAX_NOTHING || problem->layers > 1 || has_sizes(problem) || has_last_plan(first) ||
        !has_time(first))
        return;
    Objective value;
    dither_droplets(problem, first->work->threads, first->droplets, first->trial);
    if (!evaluate(first, surface, first->trial, ending_at(first), &value)) {
        first->left_out |= LEFT_STARTS;
        return;
    }
    if (value.value < first->value[START_RELAXATION].value) {
        memcpy(first->plan[START_RELAXATION], first->trial, first->places * sizeof(int32_t));
        first->value[START_RELAXATION] = value;
    }
}

/* With a limit a sound plan comes first. Without one it comes last: it is mostly the best one, and its surface is then
 * evaluated for the repair. */
static int32_t take_all(FirstPlans *first, PlanSurface *surface) {
    const bool is_rounded = first->work->relaxation != RELAX_NOTHING;
    double rounding;
    if (!is_limited(first)) {
        take_rest(first, surface);
        if (is_rounded)
            take_full_layers(first, surface);
        const int32_t status = take_sound(first, surface, &rounding);
        if (status == CORE_DONE)
            take_dithered(first, surface);
        return status;
    }
    const int32_t status = take_sound(first, surface, &rounding);
    if (status != CORE_DONE)
        return status;
    take_rest(first, surface);
    if (can_relax(first) && take_relaxed(first, surface, rounding) == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    if (is_rounded)
        take_full_layers(first, surface);
    take_dithered(first, surface);
    return CORE_DONE;
}

/* Without a limit the droplets are relaxed at once, before the memory of a surface is taken. */
int32_t make_first_plans(FirstPlans *first) {
    const double began = stopwatch_seconds();
    bool is_evaluated;
    set_droplets(first);
    if (!is_limited(first) && can_relax(first) && relax(first) == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    if (!surface_open_until(&first->surface, first->problem, first->plan[START_NOTHING], first->first_ends_at,
                            first->work->threads, &is_evaluated))
        return CORE_NO_MEMORY;
    if (is_evaluated)
        first->value[START_NOTHING] = surface_objective(&first->surface);
    first->is_there[START_NOTHING] = is_evaluated;
    const int32_t status = is_evaluated ? take_all(first, &first->surface) : CORE_TIME;
    first->seconds[PHASE_ROUNDING] = stopwatch_seconds() - began - first->seconds[PHASE_RELAXATION];
    return status;
}

void close_first_plans(FirstPlans *first) {
    surface_close(&first->surface);
}

int rank_first_plans(const FirstPlans *first, int rank[STARTS]) {
    int count = 0;
    for (int k = 0; k < STARTS; k++) {
        if (!first->is_there[k])
            continue;
        int place = count++;
        for (; place > 0 && first->value[k].value < first->value[rank[place - 1]].value; place--)
            rank[place] = rank[place - 1];
        rank[place] = k;
    }
    return count;
}
