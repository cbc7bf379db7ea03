#include "step_outputs.h"

#include <math.h>
#include <string.h>

enum { IDLE = 0, DONE = 2, UNTRUSTED = 4 }; /* values of `status` in the layer contract */

/* plan: that of the layer commanded; NULL: nothing is jetted. height: of the estimate, NULL: 0 everywhere. */
static void publish_maps(const LayerStep *step, const int32_t *plan, const double *height) {
    const LayerControllerVariables *v = step->values;
    const size_t cells = cells_of(step);
    for (size_t cell = 0; cell < cells; cell++) {
        v->pattern[cell] = plan ? material_of(plan[cell], *v->inks) : 0;
        v->drop_level[cell] = plan ? drops_of(plan[cell], *v->inks) : 1;
    }
    if (height && v->estimated_height != height)
        memcpy(v->estimated_height, height, cells * sizeof(double));
    for (size_t cell = 0; !height && cell < cells; cell++)
        v->estimated_height[cell] = 0.0;
}

static void publish_figures(const LayerStep *step, const EstimateFigures *figures) {
    const LayerControllerVariables *v = step->values;
    const int64_t ny = (int64_t)*v->ny;
    *v->volume_scale = figures->volume;
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
    *v->ink_excess_i = (int32_t)(figures->excess_cell / ny);
    *v->ink_excess_j = (int32_t)(figures->excess_cell % ny);
    *v->height_excess = figures->rise;
    *v->height_excess_i = (int32_t)(figures->rise_cell / ny);
    *v->height_excess_j = (int32_t)(figures->rise_cell % ny);
    *v->scan_corrected = figures->is_displaced != 0;
    *v->scan_shift_x = *v->pitch * figures->shift_x;
    *v->scan_shift_y = *v->pitch * figures->shift_y;
    *v->scan_shift_std = *v->pitch * figures->shift_std;
    *v->scan_spot_radius = *v->pitch * figures->spot_radius;
    *v->scan_spot_std = *v->pitch * figures->spot_std;
    *v->scan_rotation = figures->rotation;
    *v->scan_magnification = figures->magnification;
    *v->stop_layer = (int32_t)figures->stop_layer;
    *v->stop_transform = figures->transform;
    *v->stop_figure = figures->stop_figure;
}

static void publish_plan(const LayerStep *step, const PlanFigures *plan) {
    const LayerControllerVariables *v = step->values;
    *v->objective = plan->objective.value;
    *v->objective_error = plan->objective.error;
    *v->objective_deviation = plan->objective.deviation;
    *v->bound_valid = isfinite(plan->bound) != 0;
    *v->bound = *v->bound_valid ? plan->bound : 0.0;
    *v->plan_status = plan->status;
    *v->solve_time = plan->seconds;
    *v->sweeps = (int32_t)plan->sweeps;
    *v->left_out = plan->left_out;
}

static void publish_status(const LayerStep *step, const StateHead *head, int64_t stop) {
    const LayerControllerVariables *v = step->values;
    *v->layer_command = (int32_t)head->layer_command;
    *v->stop_reason = stop;
    *v->status = head->plan.status == PLAN_DONE ? DONE : *v->untrusted_reasons > 0 ? UNTRUSTED : IDLE;
}

void start_outputs(const LayerStep *step, int32_t layer_command) {
    const StateHead head = start_head(step, 1, layer_command);
    const EstimateFigures nothing_known = {.volume = 1.0, .surprise = 1.0};
    publish_figures(step, &nothing_known);
    publish_plan(step, &head.plan);
    publish_status(step, &head, 0);
    publish_maps(step, NULL, NULL);
}

void step_outputs(const LayerStep *step, const void *state) {
    const StateHead *head = state;
    if (head->estimated == NO_SCAN) {
        start_outputs(step, (int32_t)head->layer_command);
        return;
    }
    const EstimatorOptions options = estimator_options(step);
    const SurfaceEstimate estimate = known_estimate(state);
    const EstimateFigures figures = estimate_figures(&options, &estimate);
    const bool stopped = is_stopped(step, state);
    publish_figures(step, &figures);
    publish_plan(step, &head->plan);
    publish_status(step, head, stopped ? figures.stop : 0);
    publish_maps(step, stopped ? NULL : last_plan(state), estimate.height);
}
