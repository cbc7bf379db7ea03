#include "plan_search.h"

#include <stdlib.h>
#include <string.h>

#include "counter_random.h"
#include "stopwatch.h"
#include "tiled_sweep.h"

/* Temperatures as shares of what one droplet's own height is worth in the objective: hot enough to move between the
 * optima of random surfaces, cold enough to freeze (found by trial on grids whose optimum is proven). */
static const double HOT = 0.2, COLD = 0.01;

typedef struct {
    PlanSurface *surface;
    const SearchOptions *options;
    SearchReport *report;
    Tiling tiling;
    double deadline;
    uint8_t *best; /* plan with the lowest objective at the end of a sweep */
    double best_value;
} Search;

static void keep_best(Search *search) {
    const PlanSurface *surface = search->surface;
    const double value = objective(&surface->sums, &surface->weighting);
    if (value >= search->best_value)
        return;
    search->best_value = value;
    memcpy(search->best, surface->plan, surface->problem->layers * surface->framed);
}

/* One sweep, and the question whether to go on; *changes: how many were made. */
static int32_t sweep(Search *search, const Sweep *wanted, int64_t *changes) {
    bool out_of_time;
    *changes = tiled_sweep(&search->tiling, wanted, search->report, &out_of_time);
    search->report->sweeps++;
    keep_best(search);
    if (out_of_time)
        return CORE_TIME;
    const SearchOptions *options = search->options;
    search->report->objective.value = objective(&search->surface->sums, &search->surface->weighting);
    if (options->after_sweep && options->after_sweep(options->caller, search->report))
        return CORE_STOPPED;
    return CORE_DONE;
}

static int32_t anneal(Search *search) {
    const int64_t sweeps = search->options->annealing_sweeps;
    int32_t status = CORE_DONE;
    for (int64_t k = 0; k < sweeps && status == CORE_DONE; k++) {
        const double cooled = sweeps > 1 ? (double)k / (double)(sweeps - 1) : 1.0;
        const Sweep wanted = {.move = MOVE_ANNEAL,
                              .temperature = search->surface->droplet_worth * HOT * pow(COLD / HOT, cooled),
                              .key = random_word(search->options->seed, (uint64_t)k),
                              .deadline = search->deadline};
        int64_t changes;
        status = sweep(search, &wanted, &changes);
    }
    return status;
}

/* The move that comes first of those that may still help goes next: flips until none helps, then shifts and so on. */
static int32_t descend(Search *search) {
    static const int32_t ORDER[] = {MOVE_FLIPS, MOVE_SHIFTS, MOVE_SWAPS};
    enum { MOVES = sizeof ORDER / sizeof ORDER[0] };
    const SearchOptions *options = search->options;
    wake_all(search->surface, search->tiling.awake);
    bool changed = false;
    int64_t sweeps = 0;
    for (size_t k = 0; k < MOVES;) {
        if (!(options->moves & ORDER[k])) {
            k++;
        } else {
            if (sweeps++ == options->sweeps_max)
                return CORE_BUDGET;
            const Sweep wanted = {.move = ORDER[k], .deadline = search->deadline};
            int64_t changes;
            const int32_t status = sweep(search, &wanted, &changes);
            if (status != CORE_DONE)
                return status;
            changed = changed || changes > 0;
            k = changes > 0 ? 0 : k + 1;
        }
        if (k == MOVES && changed) {
            wake_all(search->surface, search->tiling.awake);
            changed = false;
            k = 0;
        }
    }
    return CORE_DONE;
}

int32_t plan_search(PlanSurface *surface, const SearchOptions *options, SearchReport *report) {
    const size_t values = surface->problem->layers * surface->framed;
    Search search = {.surface = surface,
                     .options = options,
                     .report = report,
                     .deadline = stopwatch_seconds() + options->seconds_max,
                     .best = malloc(values),
                     .best_value = INFINITY};
    if (!search.best || !tiling_open(&search.tiling, surface, options->threads)) {
        free(search.best);
        return CORE_NO_MEMORY;
    }
    keep_best(&search);
    int32_t status = anneal(&search);
    if (status == CORE_DONE)
        status = descend(&search);
    report->incremental = objective(&surface->sums, &surface->weighting);
    if (report->incremental > search.best_value) {
        memcpy(surface->plan, search.best, values);
        report->incremental = search.best_value;
    }
    tiling_close(&search.tiling);
    free(search.best);
    return status;
}
