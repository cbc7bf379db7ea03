#include "layer_handshake.h"

#include <math.h>
#include <string.h>

enum { IDLE, BUSY };
static const double ROUNDING = 1e-6;            /* of a duration: importers' times carry rounding */
static const double LAYERS_OF_A_STEP = 10000.0; /* a longer step is more likely an error (assumed) */

size_t cell_count(const LayerHandshake *h) {
    return (size_t)(*h->nx * *h->ny);
}

static double mean(const double *values, size_t count) {
    double sum = 0.0;
    for (size_t k = 0; k < count; k++)
        sum += values[k];
    return sum / (double)count;
}

void draw_volumes(const LayerHandshake *h, const VolumeVariation *how, int32_t layer, double *volumes) {
    for (size_t cell = 0; cell < cell_count(h); cell++) {
        const double nominal = *h->captured_volume * h->captured_level[cell];
        if (h->captured[cell] != 0)
            volumes[cell] = droplet_volume(how, nominal, (size_t)*h->ny, cell, layer);
    }
}

/* Adds to a counter of droplets, which stops at its largest value. */
static void add_droplets(int32_t *counter, int64_t droplets) {
    *counter = droplets > INT32_MAX - *counter ? INT32_MAX : (int32_t)(*counter + droplets);
}

static void count_droplets(const LayerHandshake *h) {
    int64_t droplets[3] = {0, 0, 0};
    for (size_t cell = 0; cell < cell_count(h); cell++)
        droplets[h->captured[cell]] += h->captured_level[cell];
    add_droplets(h->droplets_a, droplets[1]);
    add_droplets(h->droplets_b, droplets[2]);
}

static void complete_layer(Instance *instance, const LayerHandshake *h, PrintLayer *print_layer) {
    const int32_t layer = *h->layers_printed + 1;
    print_layer(instance, layer);
    count_droplets(h);
    *h->layers_printed = layer;
    *h->height_mean = mean(h->height, cell_count(h));
    *h->status = IDLE;
}

static void command_layer(const LayerHandshake *h, double time) {
    for (size_t cell = 0; cell < cell_count(h); cell++) {
        h->captured[cell] = h->drop_level[cell] > 0 ? h->pattern[cell] : 0;
        h->captured_level[cell] = h->drop_level[cell];
    }
    *h->captured_volume = *h->volume_factor;
    *h->ready_at = time + *h->layer_duration;
    *h->status = BUSY;
}

static bool is_ready(const LayerHandshake *h, double time) {
    const double rounding = ROUNDING * fmax(*h->layer_duration, *h->layer_period);
    return *h->status == BUSY && time >= *h->ready_at - rounding;
}

/* layer_period > 0: layer k is commanded at start_time + k * layer_period. */
static void command_itself(Instance *instance, const LayerHandshake *h, double end, PrintLayer *print_layer) {
    for (;;) {
        if (is_ready(h, end))
            complete_layer(instance, h, print_layer);
        if (!isfinite(*h->height_mean))
            return; /* the step will be refused */
        const double next = *h->start_time + (*h->fired + 1) * *h->layer_period;
        if (*h->status == BUSY || end < next - ROUNDING * *h->layer_period)
            return;
        command_layer(h, next);
        *h->fired += 1;
    }
}

void handshake_calculate(const LayerHandshake *h) {
    memcpy(h->height, h->height_start, cell_count(h) * sizeof *h->height);
    *h->layers_printed = *h->layer_command;
    *h->status = IDLE;
    *h->droplets_a = *h->droplets_b = 0;
    *h->height_mean = mean(h->height, cell_count(h));
}

Outcome handshake_initialize(Instance *instance, const LayerHandshake *h) {
    if (*h->layer_period > 0.0 && *h->layer_period < *h->layer_duration)
        return refuse(instance, "layer_period is %g s; expected 0 or at least layer_duration, which is %g s",
                      *h->layer_period, *h->layer_duration);
    *h->reference = *h->layer_command;
    *h->start_time = *h->time;
    *h->fired = 0;
    return ACCEPTED;
}

/* Checks the layers that the model itself would command in a step to `end`. */
static Outcome check_layers_due(Instance *instance, const LayerHandshake *h, double end) {
    const double due = (end - *h->start_time) / *h->layer_period - *h->fired;
    if (*h->layer_period <= 0.0 || (due <= LAYERS_OF_A_STEP && due < (double)(INT32_MAX - *h->layers_printed) - 2.0))
        return ACCEPTED;
    return refuse(
        instance,
        "a step to %g s has %g layers to print, at a layer_period of %g s and with %ld printed; expected at "
        "most %g in a step and layer numbers that an Int32 holds: take shorter steps or a longer layer_period",
        end, due, *h->layer_period, (long)*h->layers_printed, LAYERS_OF_A_STEP);
}

/* Whether a step to `end` may change more than the time. */
static bool is_eventful(const LayerHandshake *h, double end) {
    return *h->layer_command != *h->reference || *h->layer_period > 0.0 || is_ready(h, end);
}

/* Accepts the command at the input, if it is a new one. */
static Outcome take_command(Instance *instance, const LayerHandshake *h, double start) {
    const long asked = *h->layer_command, reference = *h->reference;
    if (asked == reference)
        return ACCEPTED;
    if (*h->layer_period > 0.0)
        return refuse(instance,
                      "layer_command changed from %ld to %ld, but layer_period is %g s and the model "
                      "commands itself; leave layer_command alone or set layer_period to 0",
                      reference, asked, *h->layer_period);
    if (*h->status == BUSY)
        return refuse(instance,
                      "layer_command is %ld while layer %ld is being printed; wait until layers_printed "
                      "is %ld",
                      asked, reference, reference);
    if (asked - 1 != reference)
        return refuse(instance, "layer_command is %ld; expected %ld (nothing to do) or %ld (print the next layer)",
                      asked, reference, reference + 1);
    *h->reference = *h->layer_command;
    command_layer(h, start);
    return ACCEPTED;
}

Outcome handshake_do_step(Instance *instance, const LayerHandshake *h, double start, double end,
                          PrintLayer *print_layer) {
    Outcome outcome = check_layers_due(instance, h, end);
    if (outcome == ACCEPTED && is_eventful(h, end) && !keep_values(instance))
        outcome = refuse(instance, "no memory to keep the surface as it is before the layer");
    if (outcome == ACCEPTED)
        outcome = take_command(instance, h, start);
    if (outcome != ACCEPTED)
        return outcome;
    if (*h->layer_period > 0.0)
        command_itself(instance, h, end, print_layer);
    else if (is_ready(h, end))
        complete_layer(instance, h, print_layer);
    return ACCEPTED;
}
