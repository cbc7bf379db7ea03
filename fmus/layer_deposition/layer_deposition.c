#include "far_neighbours.h"
#include "layer_handshake.h"
#include "layer_map.h"
#include "passes.h"
#include "layer_deposition_variables.h"

#include <string.h>

/* Levels the surface at the roller's height after a layer; returns the removed sum of heights [m]. */
static double roll(const LayerDepositionVariables *v, size_t count, int32_t layer) {
    const double top = *v->roller_datum + *v->roller_step * layer;
    double cut = 0.0;
    for (size_t cell = 0; cell < count; cell++) {
        if (v->height[cell] > top) {
            cut += v->height[cell] - top;
            v->height[cell] = top;
        }
    }
    return cut;
}

/* Prints the captured pattern in one pass, or in four that each act on the surface of the last. */
static void print_layer(Instance *instance, int32_t layer) {
    const LayerDepositionVariables v = layer_deposition_variables(instance);
    const LayerHandshake handshake = LAYER_HANDSHAKE(v);
    const VolumeVariation variation = VOLUME_VARIATION(v);
    const Passes passes = {*v.passes, *v.pass_order, *v.pass_rotation};
    const FarInk far_ink[2] = {
        {{*v.h1_a, *v.h2_a, *v.h3_a, *v.h4_a, *v.h5_a, *v.h6_a, *v.h7_a, *v.h8_a, *v.h9_a, *v.h10_a}},
        {{*v.h1_b, *v.h2_b, *v.h3_b, *v.h4_b, *v.h5_b, *v.h6_b, *v.h7_b, *v.h8_b, *v.h9_b, *v.h10_b}},
    };
    const Ink ink[2] = {{*v.h1_a, *v.h2_a, *v.h3_a}, {*v.h1_b, *v.h2_b, *v.h3_b}};
    const size_t nx = (size_t)*v.nx, ny = (size_t)*v.ny;
    const double cell_area = *v.pitch * *v.pitch;
    draw_volumes(&handshake, &variation, layer, v.factor);
    double lost = 0.0;
    for (int pass = 0; pass < passes.passes; pass++) {
        memcpy(v.before, v.height, nx * ny * sizeof *v.height);
        const int colour = pass_colour(&passes, layer, pass);
        lost += *v.reach == 1
                    ? deposit_pass(v.before, v.height, nx, ny, v.captured, ink, v.factor, colour)
                    : deposit_far_pass(v.before, v.height, nx, ny, v.captured, far_ink, *v.reach, v.factor, colour);
    }
    *v.volume_lost += lost * cell_area;
    if (*v.roller_step > 0.0)
        *v.volume_removed += roll(&v, nx * ny, layer) * cell_area;
}

static Outcome check_value(Instance *instance, size_t variable, const void *value) {
    return variable == LAYER_DEPOSITION_PASSES ? check_passes(instance, *(const int32_t *)value) : ACCEPTED;
}

static void calculate(Instance *instance) {
    const LayerDepositionVariables v = layer_deposition_variables(instance);
    handshake_calculate(&LAYER_HANDSHAKE(v));
    *v.volume_lost = *v.volume_removed = 0.0;
}

static Outcome initialize(Instance *instance) {
    const LayerDepositionVariables v = layer_deposition_variables(instance);
    const Outcome outcome = handshake_initialize(instance, &LAYER_HANDSHAKE(v));
    if (outcome == ACCEPTED)
        calculate(instance);
    return outcome;
}

static Outcome do_step(Instance *instance, double start, double end) {
    const LayerDepositionVariables v = layer_deposition_variables(instance);
    return handshake_do_step(instance, &LAYER_HANDSHAKE(v), start, end, print_layer);
}

const Model LAYER_DEPOSITION = {.table = &LAYER_DEPOSITION_VARIABLES,
                                .check_value = check_value,
                                .calculate = calculate,
                                .initialize = initialize,
                                .do_step = do_step};
