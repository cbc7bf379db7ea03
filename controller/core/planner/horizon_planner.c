#include "horizon_planner.h"

#include <math.h>
#include <string.h>

#include "first_plans.h"
#include "full_plan.h"
#include "horizon_solver.h"
#include "map_memory.h"
#include "plan_starts.h"
#include "row_ranges.h"
#include "stopwatch.h"

/* least time of a repair in evaluations: one before, one after, and some between (assumed) */
static const double LEAST_REPAIR = 3.0;
/* least share of a start's loss against the longer plan that remains after a repair (by trial) */
static const double LEFT_BY_REPAIR = 0.4;
/* share of a time limit for the proof that full layers are best (assumed) */
static const double FULL_SHARE = 0.3;
enum { ONE_LAYER_ANNEALING = 50 }; /* sweeps that reach the proven optima of small grids (by trial) */
enum { SMALL_LAYER = 20000 };      /* largest number of cells of a single layer that is annealed (assumed) */
/* largest number of values of a plan of several layers that is annealed (by trial) */
enum { SMALL_PLAN = 1000 };
enum { SMALL_ANNEALING = 40000 }; /* values drawn in annealing such a plan, in at most 200 sweeps (by trial) */
enum { MANY_SWEEPS = 200 };
enum { UNREPAIRED = -1 };

/* A plan and its origin; found: status of its search, or UNREPAIRED. */
typedef struct {
    int32_t start, is_annealed, found;
} Origin;

typedef struct {
    const HorizonProblem *problem;
    const PlanWork *work;
    size_t places; /* number of values of a plan */
    FirstPlans first;
    int32_t *repaired, *trial, *moved, *best; /* memory of `droplets` for the first and the last */
    Objective best_value;
    double best_rank; /* value by which plans are compared [m] */
    Origin best_origin;
    int64_t sweeps;
    void *memory;
} Planning;

static bool planning_open(Planning *planning, const HorizonProblem *problem, const PlanWork *work) {
    const size_t places = problem->layers * problem->nx * problem->ny;
    *planning = (Planning){.problem = problem, .work = work, .places = places};
    const double ends_at = stopwatch_seconds() + work->seconds_max;
    planning->first = (FirstPlans){.problem = problem,
                                   .work = work,
                                   .places = places,
                                   .ends_at = ends_at,
                                   .first_ends_at = work->longer ? ends_at : INFINITY};
    double *droplets = take_maps(places, sizeof(double) + (STARTS + 2) * sizeof(int32_t));
    planning->memory = droplets;
    if (!droplets)
        return false;
    planning->first.droplets = droplets; /* used until the first plans are made */
    planning->repaired = (int32_t *)droplets;
    planning->best = planning->repaired + places;
    int32_t *next = planning->best + places;
    for (int k = 0; k < STARTS; k++, next += places)
        planning->first.plan[k] = next;
    planning->trial = planning->first.trial = next;
    planning->moved = next + places; /* hardly ever used */
    return true;
}

static void copy_plan(const Planning *planning, const int32_t *plan, int32_t *to) {
    copy_in_threads((size_t)planning->work->threads, to, plan, planning->places * sizeof(int32_t));
}

static bool is_empty(const int32_t *values, size_t count) {
    for (size_t k = 0; k < count; k++)
        if (values[k] != 0)
            return false;
    return true;
}

/* Takes a plan if it is better than the best, and moves empty first layers to its end. A plan with such layers needs
 * one more evaluation, which ends at `ends_at` by the stopwatch; if it does not complete, the best plan remains. Empty
 * layers at the end hide the uncertainty of the last droplets, so a plan gains nothing by the move. */
static void consider(Planning *planning, const int32_t *plan, Objective value, Origin origin, double ends_at) {
    double rank = value.value;
    if (is_empty(plan, planning->problem->nx * planning->problem->ny)) {
        bool is_known = stopwatch_seconds() <= ends_at;
        if (is_known) {
            copy_plan(planning, plan, planning->trial);
            plan = planning->trial;
            if (leave_idle_start(planning->problem, planning->trial, planning->moved))
                is_known = plan_objective_on(&planning->first.surface, planning->trial, ends_at, &value);
        }
        if (!is_known) {
            planning->first.left_out |= LEFT_STARTS;
            return;
        }
        rank = fmax(rank, value.value);
    }
    if (rank < planning->best_rank) {
        copy_plan(planning, plan, planning->best);
        planning->best_value = value;
        planning->best_rank = rank;
        planning->best_origin = origin;
    }
}

static int64_t annealing_sweeps(const Planning *planning) {
    int64_t values = 1;
    const int64_t most = planning->problem->layers == 1 ? SMALL_LAYER : SMALL_PLAN;
    if (planning->work->device)
        return 0;
    if (planning->work->annealing_sweeps >= 0)
        return planning->work->annealing_sweeps;
    for (size_t place = 0; place < planning->places && values <= most; place++)
        values += planning->problem->choices[place] > 0;
    if (values > most)
        return 0;
    if (planning->problem->layers == 1)
        return ONE_LAYER_ANNEALING;
    return SMALL_ANNEALING / values < MANY_SWEEPS ? SMALL_ANNEALING / values : MANY_SWEEPS;
}

static int32_t improve_on_device(Planning *planning, const SearchOptions *options, SearchReport *report) {
    *report = (SearchReport){.objective = {.value = INFINITY}};
    const int32_t found = planning->work->device(planning->problem, options, planning->repaired, report);
    if (found != CORE_NO_DEVICE)
        plan_objective_on(&planning->first.surface, planning->repaired, INFINITY, &report->objective);
    return found;
}

/* CORE_STOPPED if no further start is to be repaired. */
static int32_t repair(Planning *planning, int start, int64_t annealing, double seconds) {
    const PlanWork *work = planning->work;
    const SearchOptions options = {.moves = MOVES_ALL,
                                   .annealing_sweeps = annealing,
                                   .sweeps_max = work->sweeps,
                                   .seed = work->seed,
                                   .seconds_max = seconds,
                                   .threads = work->threads,
                                   .after_sweep = work->after_sweep,
                                   .caller = work->caller};
    SearchReport report;
    copy_plan(planning, planning->first.plan[start], planning->repaired);
    const int32_t found = work->device
                              ? improve_on_device(planning, &options, &report)
                              : improve_plan_on(&planning->first.surface, &options, planning->repaired, &report);
    if (found == CORE_NO_MEMORY || found == CORE_NO_DEVICE)
        return found;
    planning->sweeps += report.sweeps;
    planning->first.left_out |= found == CORE_TIME ? LEFT_REPAIR : 0;
    const Origin origin = {start, annealing > 0, found};
    consider(planning, planning->repaired, report.objective, origin, ending_at(&planning->first));
    return found == CORE_STOPPED ? CORE_STOPPED : CORE_DONE;
}

static int32_t repair_starts(Planning *planning) {
    const double began = stopwatch_seconds();
    const int64_t annealing = annealing_sweeps(planning);
    int rank[STARTS];
    const int starts = rank_first_plans(&planning->first, rank), tasks = annealing > 0 ? starts + 1 : 1;
    int32_t status = CORE_DONE;
    for (int task = 0; task < tasks && status == CORE_DONE; task++) {
        const double seconds = seconds_left(&planning->first);
        if (seconds < LEAST_REPAIR * planning->first.evaluation) {
            planning->first.left_out |= LEFT_REPAIR;
            break;
        }
        status = repair(planning, rank[task % starts], task == starts ? annealing : 0, seconds);
    }
    planning->first.seconds[PHASE_REPAIR] = stopwatch_seconds() - began;
    return status == CORE_STOPPED ? CORE_DONE : status;
}

/* Takes full layers if they are proven best, with the objectives of full and of empty layers; skipped without any
 * time. */
static int32_t take_full_layers(Planning *planning, bool *is_best) {
    FirstPlans *first = &planning->first;
    PlanSurface surface;
    bool is_evaluated;
    const double ends_at = stopwatch_seconds() + FULL_SHARE * planning->work->seconds_max;
    *is_best =
        planning->work->seconds_max > 0.0 && fullest_plan(planning->problem, planning->work->threads, planning->best);
    if (!*is_best)
        return CORE_DONE;
    if (!surface_open_until(&surface, planning->problem, planning->best, ends_at, planning->work->threads,
                            &is_evaluated))
        return CORE_NO_MEMORY;
    *is_best = is_evaluated && is_fullest_best(&surface) && !is_empty(planning->best, planning->places);
    if (*is_best) {
        planning->best_value = surface_objective(&surface);
        planning->best_origin = (Origin){START_FULL_LAYERS, 0, CORE_DONE};
        surface_set_plan(&surface, first->plan[START_NOTHING]);
        surface_evaluate(&surface);
        first->value[START_NOTHING] = surface_objective(&surface);
        *is_best = planning->best_value.value < first->value[START_NOTHING].value;
    }
    surface_close(&surface);
    return CORE_DONE;
}

/* Whether no start can be repaired to a useful plan: 40 % of the loss of the best start already exceed the price of a
 * layer. */
static bool is_useless(const Planning *planning) {
    const PlanWork *work = planning->work;
    int rank[STARTS];
    if (!work->longer)
        return false;
    rank_first_plans(&planning->first, rank);
    return LEFT_BY_REPAIR * (planning->first.value[rank[0]].value - work->longer_value) > work->layer_price;
}

/* Compares the unrepaired starts, the best one first, with time until `first_ends_at` for that one and as long as no
 * plan prints anything. */
static void consider_starts(Planning *planning, double first_ends_at) {
    const FirstPlans *first = &planning->first;
    int rank[STARTS];
    const int starts = rank_first_plans(first, rank);
    for (int place = 0; place < starts; place++) {
        const int k = rank[place];
        const bool is_needed = place == 0 || planning->best_origin.start == START_NOTHING;
        const Origin unrepaired = {k, 0, UNREPAIRED};
        if (k != START_NOTHING)
            consider(planning, first->plan[k], first->value[k], unrepaired,
                     is_needed ? first_ends_at : ending_at(first));
    }
}

static int32_t find_best(Planning *planning) {
    FirstPlans *first = &planning->first;
    bool is_full;
    const int32_t tried = take_full_layers(planning, &is_full);
    if (tried != CORE_DONE || is_full)
        return tried;
    const int32_t made = make_first_plans(first);
    if (made != CORE_DONE)
        return made;
    copy_plan(planning, first->plan[START_NOTHING], planning->best);
    planning->best_value = first->value[START_NOTHING];
    planning->best_rank = planning->best_value.value;
    planning->best_origin = (Origin){START_NOTHING, 0, UNREPAIRED};
    if (is_useless(planning))
        return CORE_DONE;
    const int32_t repaired = repair_starts(planning);
    if (repaired != CORE_DONE)
        return repaired;
    consider_starts(planning, ending_at(first));
    if (planning->best_origin.found == UNREPAIRED && first->left_out & LEFT_STARTS)
        consider_starts(planning, first->first_ends_at); /* the best start is taken even beyond the time limit */
    return CORE_DONE;
}

static int32_t plan_status(const Planning *planning) {
    static const int32_t STATUS[] = {[CORE_DONE] = PLAN_REPAIRED,
                                     [CORE_BUDGET] = PLAN_BUDGET,
                                     [CORE_TIME] = PLAN_TIME_LIMIT,
                                     [CORE_STOPPED] = PLAN_STOPPED};
    const int32_t found = planning->best_origin.found;
    if (is_empty(planning->best, planning->places))
        return PLAN_DONE;
    return found == UNREPAIRED ? PLAN_FALLBACK : STATUS[found];
}

int32_t plan_horizon(const HorizonProblem *problem, const PlanWork *work, int32_t *plan, PlanReport *report) {
    Planning planning;
    if (!planning_open(&planning, problem, work))
        return CORE_NO_MEMORY;
    const int32_t status = find_best(&planning);
    if (status == CORE_DONE) {
        const int32_t start = planning.best_origin.start;
        copy_plan(&planning, planning.best, plan);
        *report = (PlanReport){.status = plan_status(&planning),
                               .start = start == START_LAST_PLAN && work->longer ? START_LONGER_PLAN : start,
                               .is_annealed = planning.best_origin.is_annealed,
                               .sweeps = planning.sweeps,
                               .left_out = planning.first.left_out,
                               .objective = planning.best_value,
                               .nothing = planning.first.value[START_NOTHING],
                               .evaluation = planning.first.evaluation};
        memcpy(report->seconds, planning.first.seconds, sizeof report->seconds);
    }
    close_first_plans(&planning.first);
    give_maps(planning.memory);
    return status;
}
