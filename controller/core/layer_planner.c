#include "layer_planner.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error_diffusion.h"
#include "horizon_solver.h"
#include "layer_problem.h"
#include "plan_starts.h"
#include "stopwatch.h"

static const double RELAXATION_SHARE = 0.3; /* of a time limit, at most (assumed) */
enum { ONE_LAYER_ANNEALING = 50 };          /* sweeps: these reach the proven optima of small grids (by trial) */
enum { SMALL_LAYER = 20000 };     /* cells of a single layer up to which annealing is worth its time (assumed) */
enum { SMALL_PLAN = 1000 };       /* values of a plan of several layers up to which it is (by trial) */
enum { SMALL_ANNEALING = 40000 }; /* values drawn for such a plan, in at most 200 sweeps (by trial) */
enum { MANY_SWEEPS = 200 };

/* Plans to begin from, in the order in which equal ones win. */
enum { NOTHING, FULL_LAYERS, LAST_PLAN, RELAXATION, STARTS };
enum { UNREPAIRED = -1 };

typedef struct {
    const PlannerOptions *options;
    HorizonProblem problem;
    size_t places; /* values of a plan */
    double began, rounding;
    int32_t *start[STARTS];
    Objective value[STARTS];
    int32_t *trial, *moved, *best;
    Objective best_value;
    int32_t best_found; /* how the search of the best ended, or UNREPAIRED */
    int64_t sweeps;
    ProblemMaps maps;
    double *droplets;
    void *memory;
} Planning;

static bool planning_open(Planning *planning, const PlannerOptions *options) {
    const size_t cells = options->nx * options->ny, places = options->horizon * cells;
    const size_t reals = 2 * cells + places, plans = STARTS + 3;
    *planning = (Planning){.options = options, .places = places, .began = stopwatch_seconds()};
    double *real = malloc(reals * sizeof(double) + plans * places * sizeof(int32_t) + places * sizeof(uint16_t));
    planning->memory = real;
    if (!real)
        return false;
    planning->maps.ceiling = real;
    planning->maps.weight = real + cells;
    planning->droplets = real + 2 * cells;
    int32_t *next = (int32_t *)(real + reals);
    for (int k = 0; k < STARTS; k++, next += places)
        planning->start[k] = next;
    planning->trial = next;
    planning->moved = next + places;
    planning->best = next + 2 * places;
    planning->maps.choices = (uint16_t *)(next + 3 * places);
    return true;
}

static double seconds_left(const Planning *planning) {
    return fmax(0.0, planning->began + planning->options->seconds_max - stopwatch_seconds());
}

/* Droplets of any size: one layer in one pass gains nothing by more than an even share (by trial). */
static int32_t relax(Planning *planning) {
    const PlannerOptions *options = planning->options;
    even_droplets(&planning->problem, planning->droplets);
    if (options->horizon == 1 && options->passes == 1)
        return CORE_DONE;
    const RelaxationOptions work = {options->iterations, RELAXATION_SHARE * seconds_left(planning)};
    RelaxationReport report;
    return relax_droplets(&planning->problem, &work, planning->droplets, &report);
}

static int32_t make_starts(Planning *planning, const int32_t *last) {
    const double began = stopwatch_seconds();
    memset(planning->start[NOTHING], 0, planning->places * sizeof(int32_t));
    full_layers(&planning->problem, planning->start[FULL_LAYERS]);
    shift_plan(&planning->problem, last, planning->start[LAST_PLAN]);
    int32_t status = diffuse_droplets(&planning->problem, planning->droplets, planning->start[RELAXATION]);
    for (int k = 0; k < STARTS && status != CORE_NO_MEMORY; k++)
        status = plan_objective(&planning->problem, planning->start[k], &planning->value[k]);
    planning->rounding = stopwatch_seconds() - began;
    return status;
}

/* Takes a plan, that begins with a layer then, if it is better than the best; `found`: how its search ended. */
static int32_t consider(Planning *planning, const int32_t *plan, Objective value, int32_t found) {
    memcpy(planning->trial, plan, planning->places * sizeof(int32_t));
    if (leave_idle_start(&planning->problem, planning->trial, planning->moved) &&
        plan_objective(&planning->problem, planning->trial, &value) == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    if (value.value < planning->best_value.value) {
        memcpy(planning->best, planning->trial, planning->places * sizeof(int32_t));
        planning->best_value = value;
        planning->best_found = found;
    }
    return CORE_DONE;
}

static int64_t annealing_sweeps(const Planning *planning) {
    int64_t values = 1;
    if (planning->options->annealing_sweeps >= 0)
        return planning->options->annealing_sweeps;
    for (size_t place = 0; place < planning->places; place++)
        values += planning->maps.choices[place] > 0;
    if (planning->options->horizon == 1)
        return values <= SMALL_LAYER ? ONE_LAYER_ANNEALING : 0;
    if (values > SMALL_PLAN)
        return 0;
    return SMALL_ANNEALING / values < MANY_SWEEPS ? SMALL_ANNEALING / values : MANY_SWEEPS;
}

/* The starts by their objectives, the lowest first; equal ones stay as they are. */
static void rank_starts(const Planning *planning, int rank[STARTS]) {
    for (int k = 0; k < STARTS; k++) {
        int place = k;
        for (; place > 0 && planning->value[k].value < planning->value[rank[place - 1]].value; place--)
            rank[place] = rank[place - 1];
        rank[place] = k;
    }
}

static int32_t repair(Planning *planning, int start, int64_t annealing, uint64_t key, double seconds) {
    const SearchOptions work = {.moves = MOVES_ALL,
                                .annealing_sweeps = annealing,
                                .sweeps_max = planning->options->sweeps,
                                .seed = key,
                                .seconds_max = seconds,
                                .threads = 1};
    SearchReport report;
    int32_t *plan = malloc(planning->places * sizeof(int32_t));
    int32_t status = CORE_NO_MEMORY;
    if (plan) {
        memcpy(plan, planning->start[start], planning->places * sizeof(int32_t));
        status = improve_plan(&planning->problem, &work, plan, &report);
    }
    if (status != CORE_NO_MEMORY) {
        planning->sweeps += report.sweeps;
        status = consider(planning, plan, report.objective, status);
    }
    free(plan);
    return status;
}

/* Repairs the best start, or where annealing is worth its time all of them and once more the best one, annealed. */
static int32_t repair_starts(Planning *planning, int32_t layer) {
    const uint64_t key = ((uint64_t)planning->options->seed << 32) + (uint64_t)layer;
    const int64_t annealing = annealing_sweeps(planning);
    const int tasks = annealing > 0 ? STARTS + 1 : 1;
    int rank[STARTS];
    int32_t status = CORE_DONE;
    rank_starts(planning, rank);
    for (int task = 0; task < tasks && status != CORE_NO_MEMORY; task++) {
        /* what comes after takes about as long as the rounding */
        const double seconds = seconds_left(planning) - planning->rounding;
        if (seconds <= 0.0)
            break;
        status = repair(planning, rank[task % STARTS], task == STARTS ? annealing : 0, key, seconds);
    }
    return status;
}

static bool is_empty(const int32_t *values, size_t count) {
    for (size_t k = 0; k < count; k++)
        if (values[k] != 0)
            return false;
    return true;
}

/* Drops first layers that are not worth their while: what is planned after them comes sooner. */
static int32_t drop_poor_layers(Planning *planning) {
    const size_t cells = planning->options->nx * planning->options->ny;
    const double worth_wanted = planning->options->layer_worth;
    while (worth_wanted > 0.0 && !is_empty(planning->best + cells, planning->places - cells)) {
        Objective value;
        memcpy(planning->trial, planning->best, planning->places * sizeof(int32_t));
        memset(planning->trial, 0, cells * sizeof(int32_t));
        leave_idle_start(&planning->problem, planning->trial, planning->moved);
        if (plan_objective(&planning->problem, planning->trial, &value) == CORE_NO_MEMORY)
            return CORE_NO_MEMORY;
        if (value.value - planning->best_value.value > worth_wanted * planning->best_value.value ||
            value.value >= planning->value[NOTHING].value)
            break;
        memcpy(planning->best, planning->trial, planning->places * sizeof(int32_t));
        planning->best_value = value;
    }
    return CORE_DONE;
}

static int32_t plan_status(const Planning *planning) {
    static const int32_t STATUS[] = {
        [CORE_DONE] = PLAN_REPAIRED, [CORE_BUDGET] = PLAN_BUDGET, [CORE_TIME] = PLAN_TIME_LIMIT};
    if (is_empty(planning->best, planning->places))
        return PLAN_DONE;
    return planning->best_found == UNREPAIRED ? PLAN_FALLBACK : STATUS[planning->best_found];
}

static int32_t find_best(Planning *planning, int32_t layer, const int32_t *last) {
    if (relax(planning) == CORE_NO_MEMORY || make_starts(planning, last) == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    memcpy(planning->best, planning->start[NOTHING], planning->places * sizeof(int32_t));
    planning->best_value = planning->value[NOTHING];
    planning->best_found = UNREPAIRED;
    if (repair_starts(planning, layer) == CORE_NO_MEMORY)
        return CORE_NO_MEMORY;
    for (int k = 0; k < STARTS; k++)
        if (consider(planning, planning->start[k], planning->value[k], UNREPAIRED) == CORE_NO_MEMORY)
            return CORE_NO_MEMORY;
    return drop_poor_layers(planning);
}

int32_t plan_layers(const PlannerOptions *options, int32_t colours[HORIZON_MAX][4], const SurfaceEstimate *estimate,
                    int32_t layer, const int32_t *last, int32_t *plan, PlanReport *report) {
    Planning planning;
    if (!planning_open(&planning, options))
        return CORE_NO_MEMORY;
    planning.problem = layer_problem(options, colours, estimate, layer, &planning.maps);
    const int32_t status = find_best(&planning, layer, last);
    if (status == CORE_DONE) {
        memcpy(plan, planning.best, planning.places * sizeof(int32_t));
        *report = (PlanReport){plan_status(&planning), planning.sweeps, planning.best_value};
    }
    free(planning.memory);
    return status;
}
