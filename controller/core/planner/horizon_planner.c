#include "horizon_planner.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error_diffusion.h"
#include "horizon_solver.h"
#include "plan_starts.h"
#include "stopwatch.h"

static const double RELAXATION_SHARE = 0.3; /* of a time limit, at most (assumed) */
enum { ONE_LAYER_ANNEALING = 50 };          /* sweeps: these reach the proven optima of small grids (by trial) */
enum { SMALL_LAYER = 20000 };     /* cells of a single layer up to which annealing is worth its time (assumed) */
enum { SMALL_PLAN = 1000 };       /* values of a plan of several layers up to which it is (by trial) */
enum { SMALL_ANNEALING = 40000 }; /* values drawn for such a plan, in at most 200 sweeps (by trial) */
enum { MANY_SWEEPS = 200 };
enum { UNREPAIRED = -1 };

/* A plan and its origin; found: how its search ended, or UNREPAIRED. */
typedef struct {
    int32_t start, is_annealed, found;
} Origin;

typedef struct {
    const HorizonProblem *problem;
    const PlanWork *work;
    size_t places; /* values of a plan */
    double began;
    bool is_there[STARTS];
    int32_t *start[STARTS];
    Objective value[STARTS];
    int32_t *repaired, *trial, *moved, *best;
    Objective best_value;
    Origin best_origin;
    int64_t sweeps;
    double seconds[PHASES];
    double *droplets;
    void *memory;
} Planning;

static bool planning_open(Planning *planning, const HorizonProblem *problem, const PlanWork *work) {
    const size_t places = problem->layers * problem->nx * problem->ny;
    *planning = (Planning){.problem = problem, .work = work, .places = places, .began = stopwatch_seconds()};
    double *real = malloc(places * (sizeof(double) + (STARTS + 4) * sizeof(int32_t)));
    planning->memory = real;
    if (!real)
        return false;
    planning->droplets = real;
    int32_t *next = (int32_t *)(real + places);
    for (int k = 0; k < STARTS; k++, next += places)
        planning->start[k] = next;
    planning->repaired = next;
    planning->trial = next + places;
    planning->moved = next + 2 * places;
    planning->best = next + 3 * places;
    return true;
}

static double seconds_left(const Planning *planning) {
    return fmax(0.0, planning->began + planning->work->seconds_max - stopwatch_seconds());
}

/* Droplets of any size: one layer in one pass gains nothing by more than an even share (by trial). */
static int32_t relax(Planning *planning) {
    const PlanWork *work = planning->work;
    const double began = stopwatch_seconds();
    int32_t status = CORE_DONE;
    if (work->relaxation == RELAX_GIVEN)
        memcpy(planning->droplets, work->relaxed, planning->places * sizeof(double));
    if (work->relaxation != RELAX_HERE)
        return CORE_DONE;
    even_droplets(planning->problem, planning->droplets);
    if (planning->problem->layers > 1 || planning->problem->passes > 1) {
        const RelaxationOptions options = {work->iterations, RELAXATION_SHARE * seconds_left(planning)};
        RelaxationReport report;
        status = relax_droplets(planning->problem, &options, planning->droplets, &report);
    }
    planning->seconds[PHASE_RELAXATION] = stopwatch_seconds() - began;
    return status;
}

static int32_t make_starts(Planning *planning) {
    const HorizonProblem *problem = planning->problem;
    const PlanWork *work = planning->work;
    const double began = stopwatch_seconds();
    const bool is_relaxed = work->relaxation != RELAX_NOTHING;
    int32_t status = CORE_DONE;
    memset(planning->start[START_NOTHING], 0, planning->places * sizeof(int32_t));
    full_layers(problem, planning->start[START_FULL_LAYERS]);
    if (work->last)
        shift_plan(problem, work->last, work->last_layers, planning->start[START_LAST_PLAN]);
    if (is_relaxed)
        status = diffuse_droplets(problem, planning->droplets, planning->start[START_RELAXATION]);
    for (int k = 0; k < STARTS && status != CORE_NO_MEMORY; k++) {
        planning->is_there[k] = k == START_RELAXATION ? is_relaxed : k != START_LAST_PLAN || work->last;
        if (planning->is_there[k])
            status = plan_objective(problem, planning->start[k], &planning->value[k]);
    }
    planning->seconds[PHASE_ROUNDING] = stopwatch_seconds() - began;
    return status;
}

/* Takes a plan, that begins with a layer then, if it is better than the best. */
static int32_t consider(Planning *planning, const int32_t *plan, Objective value, Origin origin) {
    memcpy(planning->trial, plan, planning->places * sizeof(int32_t));
    if (leave_idle_start(planning->problem, planning->trial, planning->moved) &&
        plan_objective(planning->problem, planning->trial, &value) == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    if (value.value < planning->best_value.value) {
        memcpy(planning->best, planning->trial, planning->places * sizeof(int32_t));
        planning->best_value = value;
        planning->best_origin = origin;
    }
    return CORE_DONE;
}

static int64_t annealing_sweeps(const Planning *planning) {
    int64_t values = 1;
    if (planning->work->annealing_sweeps >= 0)
        return planning->work->annealing_sweeps;
    for (size_t place = 0; place < planning->places; place++)
        values += planning->problem->choices[place] > 0;
    if (planning->problem->layers == 1)
        return values <= SMALL_LAYER ? ONE_LAYER_ANNEALING : 0;
    if (values > SMALL_PLAN)
        return 0;
    return SMALL_ANNEALING / values < MANY_SWEEPS ? SMALL_ANNEALING / values : MANY_SWEEPS;
}

/* The starts by their objectives, the lowest first; equal ones stay as they are. Their number. */
static int rank_starts(const Planning *planning, int rank[STARTS]) {
    int count = 0;
    for (int k = 0; k < STARTS; k++) {
        if (!planning->is_there[k])
            continue;
        int place = count++;
        for (; place > 0 && planning->value[k].value < planning->value[rank[place - 1]].value; place--)
            rank[place] = rank[place - 1];
        rank[place] = k;
    }
    return count;
}

/* CORE_STOPPED if nothing more is to be repaired. */
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
    memcpy(planning->repaired, planning->start[start], planning->places * sizeof(int32_t));
    const int32_t found = improve_plan(planning->problem, &options, planning->repaired, &report);
    if (found == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    planning->sweeps += report.sweeps;
    const Origin origin = {start, annealing > 0, found};
    const int32_t status = consider(planning, planning->repaired, report.objective, origin);
    return status == CORE_DONE && found == CORE_STOPPED ? CORE_STOPPED : status;
}

static int32_t repair_starts(Planning *planning) {
    const double began = stopwatch_seconds();
    const int64_t annealing = annealing_sweeps(planning);
    int rank[STARTS];
    const int starts = rank_starts(planning, rank), tasks = annealing > 0 ? starts + 1 : 1;
    int32_t status = CORE_DONE;
    for (int task = 0; task < tasks && status == CORE_DONE; task++) {
        /* what comes after takes about as long as the rounding */
        const double seconds = seconds_left(planning) - planning->seconds[PHASE_ROUNDING];
        if (seconds <= 0.0)
            break;
        status = repair(planning, rank[task % starts], task == starts ? annealing : 0, seconds);
    }
    planning->seconds[PHASE_REPAIR] = stopwatch_seconds() - began;
    return status == CORE_STOPPED ? CORE_DONE : status;
}

static bool is_empty(const int32_t *values, size_t count) {
    for (size_t k = 0; k < count; k++)
        if (values[k] != 0)
            return false;
    return true;
}

static int32_t find_best(Planning *planning) {
    if (relax(planning) == CORE_NO_MEMORY || make_starts(planning) == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    memcpy(planning->best, planning->start[START_NOTHING], planning->places * sizeof(int32_t));
    planning->best_value = planning->value[START_NOTHING];
    planning->best_origin = (Origin){START_NOTHING, 0, UNREPAIRED};
    if (repair_starts(planning) == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    for (int k = 0; k < STARTS; k++) {
        const Origin unrepaired = {k, 0, UNREPAIRED};
        if (planning->is_there[k] &&
            consider(planning, planning->start[k], planning->value[k], unrepaired) == CORE_NO_MEMORY)
            return CORE_NO_MEMORY;
    }
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
        memcpy(plan, planning.best, planning.places * sizeof(int32_t));
        *report = (PlanReport){.status = plan_status(&planning),
                               .start = planning.best_origin.start,
                               .is_annealed = planning.best_origin.is_annealed,
                               .sweeps = planning.sweeps,
                               .objective = planning.best_value};
        memcpy(report->seconds, planning.seconds, sizeof report->seconds);
    }
    free(planning.memory);
    return status;
}
