#include "plan_search.h"

#include <stdlib.h>
#include <string.h>

#include "counter_random.h"
#include "tiled_sweep.h"

/* Temperatures as shares of the worth of one droplet's own height in the objective: hot enough to move between the
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

/* One sweep; CORE_DONE, or the reason why the search ends here; *changes: number of changes made. */
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

/* Sweeps moves of one sort until none helps; *changed is set if one did. */
static int32_t repeat(Search *search, int32_t moves, int64_t *sweeps, bool *changed) {
    const Sweep wanted = {.move = moves, .deadline = search->deadline};
    for (int64_t changes = 1; changes > 0;) {
        if ((*sweeps)++ == search->options->sweeps_max)
            return CORE_BUDGET;
        const int32_t status = sweep(search, &wanted, &changes);
        if (status != CORE_DONE)
            return status;
        *changed = *changed || changes > 0;
    }
    return CORE_DONE;
}

/* Rounds of flips, swaps and shifts, each until none helps (order by trial on nearly flat printed surfaces). A plan
 * printed in one step has no shifts; its flips and swaps run together, tile by tile. After a round without a change a
 * sweep over all cells checks the result, unless no change reaches further than it wakes. */
static int32_t descend(Search *search) {
    static const int32_t ORDER[] = {MOVE_FLIPS, MOVE_SWAPS, MOVE_SHIFTS}, TOGETHER[] = {MOVE_FLIPS | MOVE_SWAPS};
    const PlanSurface *surface = search->surface;
    const int32_t *order = surface->steps == 1 ? TOGETHER : ORDER;
    const size_t sorts = surface->steps == 1 ? 1 : sizeof ORDER / sizeof ORDER[0];
    const bool local = surface->steps == 1 && surface->weighting.alpha == 1.0;
    int64_t sweeps = 0;
    for (bool changed_since_all = true; changed_since_all;) {
        tiling_wake(&search->tiling);
        changed_since_all = false;
        for (bool changed = true; changed;) {
            changed = false;
            for (size_t k = 0; k < sorts; k++) {
                const int32_t moves = search->options->moves & order[k];
                const int32_t status = moves ? repeat(search, moves, &sweeps, &changed) : CORE_DONE;
                if (status != CORE_DONE)
                    return status;
            }
            changed_since_all = changed_since_all || (changed && !local);
        }
    }
    return CORE_DONE;
}

int32_t plan_search(PlanSurface *surface, const SearchOptions *options, double deadline, SearchReport *report) {
    const size_t values = surface->problem->layers * surface->framed;
    Search search = {.surface = surface,
                     .options = options,
                     .report = report,
                     .deadline = deadline,
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
    const bool is_worse = report->incremental > search.best_value;
    if (is_worse) {
        memcpy(surface->plan, search.best, values);
        report->incremental = search.best_value;
    }
    if (is_worse || surface->weighting.alpha < 1.0) /* a colour that ran out of time may leave surfaces not updated */
        surface_evaluate(surface);
    else
        surface_add_up(surface);
    tiling_close(&search.tiling);
    free(search.best);
    return status;
}
