#include "controller_options.h"
#include "dead_cells.h"
#include "layer_planner.h"
#include "layer_surface.h"
#include "region_columns.h"
#include "stopwatch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { IDLE = 0, DONE = 2, UNTRUSTED = 4 };
enum { NO_SCAN = -1 };
static const double HIGHEST = 0.5;       /* [m], what the search can count with (lattice.h) */
static const double LARGEST_SHARE = 4.0; /* of a droplet's nominal height that can be learnt (ink_identification.c) */

/* What is kept in addition to the variables: numbers without padding, the response of the estimate, the last plan. */
typedef struct {
    Ink ink[INKS_MAX];
    InkKnowledge learnt;
    Registration registration;
    LoopTrust trust;
    double response[];
} Kept;

/* An answer under construction: the instance does not change before it is complete. */
typedef struct {
    SurfaceEstimate estimate;
    double *factor;
    int32_t *plan;
    PlanReport report;
    void *memory;
} Answer;

static size_t cell_count(const LayerControllerVariables *v) {
    return (size_t)(*v->nx * *v->ny);
}

static Kept *kept_of(Instance *instance, const LayerControllerVariables *v) {
    const size_t numbers = DISPLACEMENTS * sizeof(double) + (size_t)horizon_of(v) * sizeof(int32_t);
    return kept_memory(instance, sizeof(Kept) + cell_count(v) * numbers);
}

static int32_t *kept_plan(const LayerControllerVariables *v, Kept *kept) {
    return (int32_t *)(kept->response + DISPLACEMENTS * cell_count(v));
}

static bool answer_open(Answer *answer, const LayerControllerVariables *v) {
    const size_t cells = cell_count(v);
    double *real =
        malloc(cells * ((5 + DISPLACEMENTS) * sizeof(double) + (1 + (size_t)horizon_of(v)) * sizeof(int32_t) + 1));
    *answer = (Answer){.memory = real};
    if (!real)
        return false;
    answer->estimate.height = real;
    answer->estimate.variance = real + cells;
    answer->estimate.dead_evidence = real + 2 * cells;
    answer->factor = real + 3 * cells;
    answer->estimate.reckoned = real + 4 * cells;
    answer->estimate.response = real + 5 * cells;
    answer->estimate.unseen = (int32_t *)(real + (5 + DISPLACEMENTS) * cells);
    answer->plan = answer->estimate.unseen + cells;
    answer->estimate.capped = (uint8_t *)(answer->plan + (size_t)horizon_of(v) * cells);
    return true;
}

/* What is known after the scan at the inputs; false if there is no memory. */
static bool estimate(const LayerControllerVariables *v, Kept *kept, Answer *answer) {
    const EstimatorOptions options = estimator_options(v);
    const Passes passes = passes_of(v);
    const uint8_t *valid = (const uint8_t *)v->valid;
    int32_t order[COLOURS];
    if (*v->answered == NO_SCAN)
        return estimate_first(&options, *v->layers_scanned, v->measured_height, valid, &answer->estimate);
    for (int pass = 0; pass < COLOURS; pass++)
        order[pass] = pass_colour(&passes, *v->layers_scanned, pass);
    for (size_t cell = 0; cell < cell_count(v); cell++)
        answer->factor[cell] = v->drop_level[cell];
    const JettedLayer layer = {options.nx, options.ny, v->pattern, answer->factor, *v->passes, order, 1};
    SurfaceEstimate before = {.height = v->estimated_height,
                              .variance = v->height_variance,
                              .unseen = v->unseen,
                              .dead_evidence = v->dead_evidence,
                              .response = kept->response,
                              .reckoned = v->reckoned,
                              .learnt = kept->learnt,
                              .registration = kept->registration,
                              .trust = kept->trust,
                              .noise_variance = *v->noise_variance,
                              .scans = *v->scans};
    memcpy(before.ink, kept->ink, sizeof before.ink);
    return *v->layer_unknown ? estimate_unknown(&options, &before, &layer, v->measured_height, valid, &answer->estimate)
                             : estimate_next(&options, &before, &layer, v->measured_height, valid, &answer->estimate);
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
static bool plan(Instance *instance, const LayerControllerVariables *v, Kept *kept, Answer *answer, double elapsed) {
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
    return plan_layers(&options, colours, &answer->estimate, *v->layers_scanned, kept_plan(v, kept), answer->plan,
                       &answer->report) == CORE_DONE;
}

static void publish_displacement(const LayerControllerVariables *v, const Registration *registration) {
    const ScanDisplacement cells = reported_displacement(registration);
    *v->scan_corrected = is_displaced(registration);
    *v->scan_shift_x = *v->pitch * cells.shift_x;
    *v->scan_shift_y = *v->pitch * cells.shift_y;
    *v->scan_shift_std = *v->pitch * cells.shift_std;
    *v->scan_spot_radius = *v->pitch * cells.spot_radius;
    *v->scan_spot_std = *v->pitch * cells.spot_std;
}

static void publish_trust(const LayerControllerVariables *v, const LoopTrust *trust) {
    *v->untrusted_reasons = untrusted_reasons(trust);
    *v->untrusted_cells = trust->unseen_cells;
    *v->capped_cells = (int32_t)trust->capped_cells;
    *v->blind_share = trust->blind_share;
    *v->ground_offset = trust->ground[0];
    *v->ground_rise_x = trust->ground[1];
    *v->ground_rise_y = trust->ground[2];
    *v->scan_surprise = sqrt(trust->residual);
    *v->ink_excess = trust->excess;
    *v->ink_excess_i = (int32_t)(trust->excess_cell / (int64_t)*v->ny);
    *v->ink_excess_j = (int32_t)(trust->excess_cell % (int64_t)*v->ny);
    *v->height_excess = trust->rise;
    *v->height_excess_i = (int32_t)(trust->rise_cell / (int64_t)*v->ny);
    *v->height_excess_j = (int32_t)(trust->rise_cell % (int64_t)*v->ny);
}

static void keep_estimate(const LayerControllerVariables *v, Kept *kept, const SurfaceEstimate *estimate) {
    const size_t cells = cell_count(v);
    const InkPrior prior = nominal_inks(v);
    memcpy(v->estimated_height, estimate->height, cells * sizeof(double));
    memcpy(v->height_variance, estimate->variance, cells * sizeof(double));
    memcpy(v->dead_evidence, estimate->dead_evidence, cells * sizeof(double));
    memcpy(kept->response, estimate->response, DISPLACEMENTS * cells * sizeof(double));
    memcpy(v->unseen, estimate->unseen, cells * sizeof(int32_t));
    memcpy(kept->ink, estimate->ink, sizeof kept->ink);
    memcpy(v->reckoned, estimate->reckoned, cells * sizeof(double));
    kept->learnt = estimate->learnt;
    kept->registration = estimate->registration;
    kept->trust = estimate->trust;
    publish_displacement(v, &estimate->registration);
    publish_trust(v, &estimate->trust);
    *v->noise_variance = estimate->noise_variance;
    *v->scans = estimate->scans;
    *v->volume_scale = layers_of_all(estimate->ink, prior.inks) / layers_of_all(prior.nominal, prior.inks);
    *v->dead_cells = 0;
    for (size_t cell = 0; cell < cells; cell++)
        *v->dead_cells += v->dead_evidence[cell] >= DEAD_EVIDENCE;
}

static void publish_plan(const LayerControllerVariables *v, Kept *kept, const Answer *answer, double seconds) {
    const size_t cells = cell_count(v);
    const bool is_done = answer->report.status == PLAN_DONE;
    memcpy(kept_plan(v, kept), answer->plan, (size_t)horizon_of(v) * cells * sizeof(int32_t));
    for (size_t cell = 0; cell < cells; cell++) {
        const int32_t kind = answer->plan[cell] - 1;
        v->pattern[cell] = kind < 0 ? 0 : 1 + kind % *v->inks;
        v->drop_level[cell] = kind < 0 ? 1 : 1 + kind / *v->inks;
    }
    *v->layer_command += is_done ? 0 : 1;
    *v->answered = *v->layers_scanned;
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
    Kept *kept = kept_of(instance, &v);
    if (!kept)
        return refuse(instance, "no memory for the plan of %lu cells", (unsigned long)cell_count(&v));
    memset(kept_plan(&v, kept), 0, (size_t)horizon_of(&v) * cell_count(&v) * sizeof(int32_t));
    calculate(instance);
    *v.layer_command = *v.layers_printed;
    *v.answered = NO_SCAN;
    return ACCEPTED;
}

static Outcome do_step(Instance *instance, double start, double end) {
    const LayerControllerVariables v = layer_controller_variables(instance);
    const bool is_new = *v.layers_scanned == *v.layers_printed && *v.layers_scanned == *v.layer_command &&
                        *v.layers_scanned > *v.answered;
    (void)start, (void)end;
    if (*v.status == DONE || !is_new)
        return ACCEPTED;
    const double began = stopwatch_seconds();
    Kept *kept = kept_of(instance, &v);
    Answer answer;
    if (!kept || !answer_open(&answer, &v))
        return refuse(instance, "no memory for a plan of %lu cells", (unsigned long)cell_count(&v));
    Outcome outcome = ACCEPTED;
    if (!estimate(&v, kept, &answer))
        outcome = refuse(instance, "no memory to estimate %lu cells", (unsigned long)cell_count(&v));
    if (outcome == ACCEPTED)
        outcome = check_heights(instance, &v, answer.estimate.height);
    if (outcome == ACCEPTED && !plan(instance, &v, kept, &answer, stopwatch_seconds() - began))
        outcome = refuse(instance, "no memory to plan %lu cells", (unsigned long)cell_count(&v));
    if (outcome == ACCEPTED && !keep_values(instance))
        outcome = refuse(instance, "no memory to keep the last plan until the next one is whole");
    if (outcome == ACCEPTED) {
        keep_estimate(&v, kept, &answer.estimate);
        publish_plan(&v, kept, &answer, stopwatch_seconds() - began);
    }
    free(answer.memory);
    return outcome;
}

const Model LAYER_CONTROLLER = {.table = &LAYER_CONTROLLER_VARIABLES,
                                .check_value = check_value,
                                .calculate = calculate,
                                .initialize = initialize,
                                .do_step = do_step};
