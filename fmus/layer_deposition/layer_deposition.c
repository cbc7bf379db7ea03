#include "droplet_volume.h"
#include "layer_map.h"
#include "variables.h"

#include <math.h>
#include <string.h>

enum { IDLE, BUSY };
enum { COLOURS = 4 };
static const double ROUNDING = 1e-6; /* of a duration: importers' times carry rounding */

/* pass_order - 1, place in the order -> colour 2 * (i % 2) + (j % 2) */
static const int ORDERS[2][COLOURS] = {{0, 1, 2, 3}, {0, 3, 1, 2}};

static size_t cell_count(const LayerDepositionVariables *v) {
    return (size_t)(*v->nx * *v->ny);
}

static double mean(const double *values, size_t count) {
    double sum = 0.0;
    for (size_t k = 0; k < count; k++)
        sum += values[k];
    return sum / (double)count;
}

/* Volumes in nominal drops: their number, times the factor of the layer, times what varies. */
static void draw_factors(const LayerDepositionVariables *v, int32_t layer) {
    const VolumeVariation how = {.variation = *v->variation,
                                 .kind = (VariationKind)*v->variation_kind,
                                 .nozzle_variation = *v->nozzle_variation,
                                 .nozzle_pitch = *v->nozzle_pitch,
                                 .seed = *v->seed};
    for (size_t cell = 0; cell < cell_count(v); cell++) {
        const double nominal = *v->captured_volume * v->captured_level[cell];
        if (v->captured[cell] != 0)
            v->factor[cell] = droplet_volume(&how, nominal, (size_t)*v->ny, cell, layer);
    }
}

static void count_droplets(const LayerDepositionVariables *v) {
    for (size_t cell = 0; cell < cell_count(v); cell++) {
        *v->droplets_a += v->captured[cell] == 1 ? v->captured_level[cell] : 0;
        *v->droplets_b += v->captured[cell] == 2 ? v->captured_level[cell] : 0;
    }
}

/* Cuts the surface at the roller's height after a layer; what was cut, as a sum of heights [m]. */
static double roll(const LayerDepositionVariables *v, int32_t layer) {
    const double top = *v->roller_datum + *v->roller_step * layer;
    double cut = 0.0;
    for (size_t cell = 0; cell < cell_count(v); cell++) {
        if (v->height[cell] > top) {
            cut += v->height[cell] - top;
            v->height[cell] = top;
        }
    }
    return cut;
}

/* The captured pattern becomes the next layer, in one pass or in four that each act on the surface of the last. */
static void complete_layer(const LayerDepositionVariables *v) {
    const Ink ink[2] = {{*v->h1_a, *v->h2_a, *v->h3_a}, {*v->h1_b, *v->h2_b, *v->h3_b}};
    const size_t nx = (size_t)*v->nx, ny = (size_t)*v->ny, count = cell_count(v);
    const int32_t layer = *v->layers_printed + 1;
    const double cell_area = *v->pitch * *v->pitch;
    draw_factors(v, layer);
    double lost = 0.0;
    for (int pass = 0; pass < *v->passes; pass++) {
        const int64_t place = ((int64_t)*v->pass_rotation * layer + pass) % COLOURS;
        const int colour = *v->passes == 1 ? COLOUR_ALL : ORDERS[*v->pass_order - 1][place];
        memcpy(v->before, v->height, count * sizeof *v->height);
        lost += deposit_pass(v->before, v->height, nx, ny, v->captured, ink, v->factor, colour);
    }
    if (*v->roller_step > 0.0)
        *v->volume_removed += roll(v, layer) * cell_area;
    count_droplets(v);
    *v->layers_printed = layer;
    *v->height_mean = mean(v->height, count);
    *v->volume_lost += lost * cell_area;
    *v->status = IDLE;
}

static void command_layer(const LayerDepositionVariables *v, double time) {
    for (size_t cell = 0; cell < cell_count(v); cell++) {
        v->captured[cell] = v->drop_level[cell] > 0 ? v->pattern[cell] : 0;
        v->captured_level[cell] = v->drop_level[cell];
    }
    *v->captured_volume = *v->volume_factor;
    *v->ready_at = time + *v->layer_duration;
    *v->status = BUSY;
}

static bool is_ready(const LayerDepositionVariables *v, double time) {
    const double rounding = ROUNDING * fmax(*v->layer_duration, *v->layer_period);
    return *v->status == BUSY && time >= *v->ready_at - rounding;
}

/* layer_period > 0: layer k is commanded at start_time + k * layer_period. */
static void command_itself(const LayerDepositionVariables *v, double end) {
    for (;;) {
        if (is_ready(v, end))
            complete_layer(v);
        const double next = *v->start_time + (*v->fired + 1) * *v->layer_period;
        if (*v->status == BUSY || end < next - ROUNDING * *v->layer_period)
            return;
        command_layer(v, next);
        *v->fired += 1;
    }
}

Outcome kernel_check_value(Instance *instance, size_t variable, const void *value) {
    if (variable != VARIABLE_PASSES)
        return ACCEPTED;
    const int32_t passes = *(const int32_t *)value;
    if (passes == 1 || passes == COLOURS)
        return ACCEPTED;
    return refuse(instance, "passes is %ld; expected 1 or 4; nothing was set", (long)passes);
}

void kernel_calculate(Instance *instance) {
    const LayerDepositionVariables v = layer_deposition_variables(instance);
    memcpy(v.height, v.height_start, cell_count(&v) * sizeof *v.height);
    *v.layers_printed = *v.layer_command;
    *v.status = IDLE;
    *v.droplets_a = *v.droplets_b = 0;
    *v.height_mean = mean(v.height, cell_count(&v));
    *v.volume_lost = *v.volume_removed = 0.0;
}

Outcome kernel_initialize(Instance *instance) {
    const LayerDepositionVariables v = layer_deposition_variables(instance);
    if (*v.layer_period > 0.0 && *v.layer_period < *v.layer_duration)
        return refuse(instance, "layer_period is %g s; expected 0 or at least layer_duration, which is %g s",
                      *v.layer_period, *v.layer_duration);
    kernel_calculate(instance);
    *v.reference = *v.layer_command;
    *v.start_time = *v.time;
    *v.fired = 0;
    return ACCEPTED;
}

Outcome kernel_do_step(Instance *instance, double start, double end) {
    const LayerDepositionVariables v = layer_deposition_variables(instance);
    const long asked = *v.layer_command, reference = *v.reference;
    if (asked != reference) {
        if (*v.layer_period > 0.0)
            return refuse(instance,
                          "layer_command changed from %ld to %ld, but layer_period is %g s and the model "
                          "commands itself; leave layer_command alone or set layer_period to 0",
                          reference, asked, *v.layer_period);
        if (*v.status == BUSY)
            return refuse(instance,
                          "layer_command is %ld while layer %ld is being printed; wait until layers_printed "
                          "is %ld",
                          asked, reference, reference);
        if (asked - 1 != reference)
            return refuse(instance, "layer_command is %ld; expected %ld (nothing to do) or %ld (print the next layer)",
                          asked, reference, reference + 1);
        *v.reference = *v.layer_command;
        command_layer(&v, start);
    }
    if (*v.layer_period > 0.0)
        command_itself(&v, end);
    else if (is_ready(&v, end))
        complete_layer(&v);
    return ACCEPTED;
}
