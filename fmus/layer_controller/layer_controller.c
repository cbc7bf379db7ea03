#include "controller_options.h"
#include "layer_planner.h"
#include "layer_surface.h"
#include "observer.h"
#include "region_columns.h"
#include "stopwatch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { IDLE = 0, DONE = 2, UNTRUSTED = 4 };
enum { NO_SCAN = -1 };
enum { STOP_ON_DOUBT = 1 };              /* of OnDoubt in variables.toml */
static const double HIGHEST = 0.5;       /* [m], what the search can count with (lattice.h) */
static const double LARGEST_SHARE = 2.0; /* of a droplet's nominal height that can be learnt (scan_fit.c) */

/* An answer under construction: the instance does not change before it is complete. */
typedef struct {
    SurfaceEstimate estimate;
    EstimateFigures figures;
    double *factor;
    int32_t *plan;
    PlanReport report;
    void *memory;
} Answer;

static size_t cell_count(const LayerControllerVariables *v) {
    return (size_t)(*v->nx * *v->ny);
}

static size_t plan_size(const LayerControllerVariables *v) {
    return (size_t)horizon_of(v) * cell_count(v) * sizeof(int32_t);
}

/* What is kept in addition to the variables: the estimate in one block, and the last plan behind it. */
static void *kept_of(Instance *instance, const LayerControllerVariables *v) {
    return kept_memory(instance, estimate_size(cell_count(v)) + plan_size(v));
}

static int32_t *kept_plan(const LayerControllerVariables *v, void *kept) {
    return (int32_t *)((char *)kept + estimate_size(cell_count(v)));
}

static bool answer_open(Answer *answer, const LayerControllerVariables *v) {
    const size_t cells = cell_count(v), size = estimate_size(cells);
    char *memory = calloc(1, size + cells * sizeof(double) + plan_size(v)); /* a state repeats bit by bit */
    *answer = (Answer){.memory = memory};
    if (!memory)
        return false;
    answer->estimate = estimate_in(memory, cells);
    answer->factor = (double *)(memory + size);
    answer->plan = (int32_t *)(answer->factor + cells);
    return true;
}

/* Whether a person has looked at a print that was stopped: its last scan is answered again. */
static bool is_looked_at(const LayerControllerVariables *v) {
    return *v->looked_at && *v->stop_reason != 0;
}

/* What is known after the scan at the inputs; false if there is no memory. */
static bool estimate(const LayerControllerVariables *v, void *kept, Answer *answer) {
    const EstimatorOptions options = estimator_options(v);
    const Passes passes = passes_of(v);
    const uint8_t *valid = (const uint8_t *)v->valid;
    int32_t order[COLOURS];
    if (is_looked_at(v)) {
        memcpy(answer->memory, kept, estimate_size(cell_count(v)));
        trust_again(&answer->estimate, cell_count(v));
        return true;
    }
    if (*v->answered == NO_SCAN)
        return estimate_first(&options, *v->layers_scanned, v->measured_height, valid, &answer->estimate);
    for (int pass = 0; pass < COLOURS; pass++)
        order[pass] = pass_colour(&passes, *v->layers_scanned, pass);
    for (size_t cell = 0; cell < cell_count(v); cell++)
        answer->factor[cell] = v->drop_level[cell];
    const JettedLayer layer = {options.nx, options.ny, v->pattern, answer->factor, *v->passes, order, 1};
    const SurfaceEstimate before = estimate_in(kept, options.nx * options.ny);
    return estimate_next(&options, &before, &layer, *v->layers_scanned, *v->layer_unknown, v->measured_height, valid,
                         &answer->estimate);
}

static Outcome check_heights(Instance *instance, const LayerControllerVariables *v, const double *height) {
    const InkPrior prior = nominal_inks(v);
    const double tallest = fmax(full_layer_height(&prior.nominal[0]), full_layer_height(&prior.nominal[1]));
    const double room = HIGHEST - 2.0 * horizon_of(v) * *v->drop_levels * LARGEST_SHARE * tallest;
    for (size_t cell = 0; cell < cell_count(v); cell++) {
        if (fabs(height[cell]) < room && v->target_height[cell] < room)
            continue;
        return refuse(instance,
                      "cell (%lu, %lu) is estimated at %g m, its target is %g m; expected heights within %g m with "
                      "%ld layers to come: count them from a surface near by",
                      (unsigned long)(cell / *v->ny), (unsigned long)(cell % *v->ny), height[cell],
                      v->target_height[cell], room, (long)horizon_of(v));
    }
    return ACCEPTED;
}

/* The plan for the layers after the scan, which was taken `elapsed` seconds ago; false if there is no memory. */
static bool plan(Instance *instance, const LayerControllerVariables *v, void *kept, Answer *answer, double elapsed) {
    InkRegions regions;
    if (!region_columns(instance, v, &regions))
        return false;
    PlannerOptions options = planner_options(v, regions);
    options.seconds_max -= elapsed;
    const Passes passes = passes_of(v);
    int32_t colours[HORIZON_MAX][4];
    for (int32_t ahead = 0; ahead < HORIZON_MAX; ahead++)
        for (int pass = 0; pass < COLOURS; pass++)
            colours[ahead][pass] = pass_colour(&passes, *v->layers_scanned + 1 + ahead, pass);
    return plan_layers(&options, colours, &answer->estimate, &answer->figures, *v->layers_scanned, kept_plan(v, kept),
                       answer->plan, &answer->report) == CORE_DONE;
}

/* Whether the scans do not show what was printed, and that ends the print. */
static bool is_stopped(const LayerControllerVariables *v, const EstimateFigures *figures) {
    return *v->on_doubt == STOP_ON_DOUBT && figures->stop != 0;
}

static void publish_figures(const LayerControllerVariables *v, const EstimateFigures *figures) {
    *v->scan_corrected = figures->is_displaced != 0;
    *v->scan_shift_x = *v->pitch * figures->shift_x;
    *v->scan_shift_y = *v->pitch * figures->shift_y;
    *v->scan_shift_std = *v->pitch * figures->shift_std;
    *v->scan_spot_radius = *v->pitch * figures->spot_radius;
    *v->scan_spot_std = *v->pitch * figures->spot_std;
    *v->scan_rotation = figures->rotation;
    *v->scan_magnification = figures->magnification;
    *v->untrusted_reasons = (int32_t)figures->reasons;
    *v->untrusted_cells = (int32_t)figures->unseen_cells;
    *v->dead_cells = (int32_t)figures->dead_cells;
    *v->capped_cells = (int32_t)figures->capped_cells;
    *v->blind_share = figures->blind_share;
    *v->ground_offset = figures->ground[0];
    *v->ground_rise_x = figures->ground[1];
    *v->ground_rise_y = figures->ground[2];
    *v->scan_surprise = figures->surprise;
    *v->ink_excess = figures->excess;
    *v->ink_excess_i = (int32_t)(figures->excess_cell / (int64_t)*v->ny);
    *v->ink_excess_j = (int32_t)(figures->excess_cell % (int64_t)*v->ny);
    *v->height_excess = figures->rise;
    *v->height_excess_i = (int32_t)(figures->rise_cell / (int64_t)*v->ny);
    *v->height_excess_j = (int32_t)(figures->rise_cell % (int64_t)*v->ny);
    *v->volume_scale = figures->volume;
    *v->stop_reason = is_stopped(v, figures) ? (int32_t)figures->stop : 0;
    *v->stop_layer = (int32_t)figures->stop_layer;
    *v->stop_transform = (int32_t)figures->transform;
    *v->stop_figure = figures->stop_figure;
}

static void keep_estimate(const LayerControllerVariables *v, void *kept, const Answer *answer) {
    const size_t cells = cell_count(v);
    memcpy(v->estimated_height, answer->estimate.height, cells * sizeof(double));
    memcpy(kept, answer->memory, estimate_size(cells));
    publish_figures(v, &answer->figures);
    *v->answered = *v->layers_scanned;
}

/* The print ends here: nothing is jetted any longer. */
static void publish_stop(const LayerControllerVariables *v) {
    memset(v->pattern, 0, cell_count(v) * sizeof *v->pattern);
    *v->status = UNTRUSTED;
}

static void publish_plan(const LayerControllerVariables *v, void *kept, const Answer *answer, double seconds) {
    const size_t cells = cell_count(v);
    const bool is_done = answer->report.status == PLAN_DONE;
    memcpy(kept_plan(v, kept), answer->plan, plan_size(v));
    for (size_t cell = 0; cell < cells; cell++) {
        const int32_t kind = answer->plan[cell] - 1;
        v->pattern[cell] = kind < 0 ? 0 : 1 + kind % *v->inks;
        v->drop_level[cell] = kind < 0 ? 1 : 1 + kind / *v->inks;
    }
    *v->layer_command += is_done ? 0 : 1;
    *v->status = is_done ? DONE : *v->untrusted_reasons > 0 ? UNTRUSTED : IDLE;
    *v->objective = answer->report.objective.value;
    *v->objective_error = answer->report.objective.error;
    *v->objective_deviation = answer->report.objective.deviation;
    *v->plan_status = answer->report.status;
    *v->sweeps = (int32_t)answer->report.sweeps;
    *v->left_out = answer->report.left_out;
    *v->solve_time = *v->is_timed ? seconds : 0.0;
}

static Outcome check_value(Instance *instance, size_t variable, const void *value) {
    return variable == LAYER_CONTROLLER_PASSES ? check_passes(instance, *(const int32_t *)value) : ACCEPTED;
}

static void calculate(Instance *instance) {
    const LayerControllerVariables v = layer_controller_variables(instance);
    for (size_t cell = 0; cell < cell_count(&v); cell++) {
        v.pattern[cell] = 0;
        v.drop_level[cell] = 1;
        v.estimated_height[cell] = 0.0;
    }
    *v.layer_command = 0; /* not layers_printed, which the printer derives from this command: that is a loop */
    *v.status = IDLE;
    *v.objective = *v.objective_error = *v.objective_deviation = *v.bound = *v.solve_time = 0.0;
    *v.bound_valid = false;
    *v.scan_corrected = false;
    *v.scan_shift_x = *v.scan_shift_y = *v.scan_shift_std = *v.scan_spot_radius = *v.scan_spot_std = 0.0;
    *v.plan_status = *v.sweeps = *v.left_out = *v.untrusted_cells = *v.dead_cells = 0;
    *v.stop_reason = *v.stop_layer = *v.stop_transform = 0;
    *v.stop_figure = *v.scan_rotation = *v.scan_magnification = 0.0;
    *v.volume_scale = 1.0;
}

static Outcome initialize(Instance *instance) {
    const LayerControllerVariables v = layer_controller_variables(instance);
    size_t part = 0;
    for (size_t cell = 0; cell < cell_count(&v); cell++)
        part += v.mask[cell];
    if (part == 0)
        return refuse(instance, "mask marks no cell; expected the cells of the part");
    if (*v.drop_levels * *v.inks > KINDS_MAX)
        return refuse(instance, "drop_levels is %ld with %ld inks; expected at most %d", (long)*v.drop_levels,
                      (long)*v.inks, KINDS_MAX / (int)*v.inks);
    void *kept = kept_of(instance, &v);
    if (!kept)
        return refuse(instance, "no memory for the plan of %lu cells", (unsigned long)cell_count(&v));
    memset(kept_plan(&v, kept), 0, plan_size(&v));
    calculate(instance);
    *v.layer_command = *v.layers_printed;
    *v.answered = NO_SCAN;
    return ACCEPTED;
}

static Outcome do_step(Instance *instance, double start, double end) {
    const LayerControllerVariables v = layer_controller_variables(instance);
    const bool is_new = *v.layers_scanned == *v.layers_printed && *v.layers_scanned == *v.layer_command &&
                        (*v.layers_scanned > *v.answered || is_looked_at(&v));
    (void)start, (void)end;
    if (*v.status == DONE || !is_new)
        return ACCEPTED;
    const double began = stopwatch_seconds();
    void *kept = kept_of(instance, &v);
    Answer answer;
    if (!kept || !answer_open(&answer, &v))
        return refuse(instance, "no memory for a plan of %lu cells", (unsigned long)cell_count(&v));
    Outcome outcome = ACCEPTED;
    if (!estimate(&v, kept, &answer))
        outcome = refuse(instance, "no memory to estimate %lu cells", (unsigned long)cell_count(&v));
    if (outcome == ACCEPTED) {
        const EstimatorOptions options = estimator_options(&v);
        answer.figures = estimate_figures(&options, &answer.estimate);
        outcome = check_heights(instance, &v, answer.estimate.height);
    }
    const bool has_plan = !is_stopped(&v, &answer.figures);
    if (outcome == ACCEPTED && has_plan && !plan(instance, &v, kept, &answer, stopwatch_seconds() - began))
        outcome = refuse(instance, "no memory to plan %lu cells", (unsigned long)cell_count(&v));
    if (outcome == ACCEPTED && !keep_values(instance))
        outcome = refuse(instance, "no memory to keep the last plan until the next one is whole");
    if (outcome == ACCEPTED) {
        keep_estimate(&v, kept, &answer);
        if (has_plan)
            publish_plan(&v, kept, &answer, stopwatch_seconds() - began);
        else
            publish_stop(&v);
    }
    free(answer.memory);
    return outcome;
}

const Model LAYER_CONTROLLER = {.table = &LAYER_CONTROLLER_VARIABLES,
                                .check_value = check_value,
                                .calculate = calculate,
                                .initialize = initialize,
                                .do_step = do_step};
