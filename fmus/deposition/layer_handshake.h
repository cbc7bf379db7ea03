/* The layer contract of every deposition model: acceptance of commands, completion of layers, and counters. A model has
 * variables with the names below and prints a layer; it does not handle time. */
#ifndef INKLOOP_LAYER_HANDSHAKE_H
#define INKLOOP_LAYER_HANDSHAKE_H

#include "droplet_volume.h"
#include "kernel.h"

typedef struct {
    const double *time;
    const uint64_t *nx, *ny;
    const int32_t *pattern, *drop_level, *layer_command;
    const double *volume_factor;
    double *height;
    int32_t *layers_printed, *droplets_a, *droplets_b;
    int64_t *status;
    double *height_mean;
    const double *height_start, *layer_duration, *layer_period;
    int32_t *reference;                 /* the last accepted command */
    int32_t *captured, *captured_level; /* pattern and drop levels of that command */
    double *captured_volume, *ready_at, *start_time;
    int32_t *fired; /* layers that the model has commanded itself */
} LayerHandshake;

/* The handshake of a model whose struct of variables has these names. */
#define LAYER_HANDSHAKE(v)                                                                                             \
    ((LayerHandshake){.time = (v).time,                                                                                \
                      .nx = (v).nx,                                                                                    \
                      .ny = (v).ny,                                                                                    \
                      .pattern = (v).pattern,                                                                          \
                      .drop_level = (v).drop_level,                                                                    \
                      .layer_command = (v).layer_command,                                                              \
                      .volume_factor = (v).volume_factor,                                                              \
                      .height = (v).height,                                                                            \
                      .layers_printed = (v).layers_printed,                                                            \
                      .status = (v).status,                                                                            \
                      .droplets_a = (v).droplets_a,                                                                    \
                      .droplets_b = (v).droplets_b,                                                                    \
                      .height_mean = (v).height_mean,                                                                  \
                      .height_start = (v).height_start,                                                                \
                      .layer_duration = (v).layer_duration,                                                            \
                      .layer_period = (v).layer_period,                                                                \
                      .reference = (v).reference,                                                                      \
                      .captured = (v).captured,                                                                        \
                      .captured_level = (v).captured_level,                                                            \
                      .captured_volume = (v).captured_volume,                                                          \
                      .ready_at = (v).ready_at,                                                                        \
                      .start_time = (v).start_time,                                                                    \
                      .fired = (v).fired})

/* The variation of droplet volumes of a model whose struct of variables has these names. */
#define VOLUME_VARIATION(v)                                                                                            \
    ((VolumeVariation){.variation = *(v).variation,                                                                    \
                       .kind = (VariationKind) * (v).variation_kind,                                                   \
                       .nozzle_variation = *(v).nozzle_variation,                                                      \
                       .nozzle_pitch = *(v).nozzle_pitch,                                                              \
                       .seed = *(v).seed})

/* Puts layer number `layer` (from 1 on), which is the captured pattern, onto the surface `height`. */
typedef void PrintLayer(Instance *instance, int32_t layer);

size_t cell_count(const LayerHandshake *handshake);

/* Volume of each captured droplet in nominal drops: its number of drops times the factors of the layer and of the
 * droplet; values of cells without a droplet are kept. */
void draw_volumes(const LayerHandshake *handshake, const VolumeVariation *how, int32_t layer, double *volumes);

/* The three functions of kernel.h; the model adds its own part. handshake_calculate sets `height` to `height_start`. */
void handshake_calculate(const LayerHandshake *handshake);
Outcome handshake_initialize(Instance *instance, const LayerHandshake *handshake);
Outcome handshake_do_step(Instance *instance, const LayerHandshake *handshake, double start, double end,
                          PrintLayer *print_layer);

#endif
