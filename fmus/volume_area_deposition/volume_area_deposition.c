#include "layer_handshake.h"
#include "passes.h"
#include "propagation.h"
#include "volume_area_deposition_variables.h"

#include <string.h>

enum { RASTER = 1, SERPENTINE, COLUMNS };       /* DropOrder */
static const double CAP_RADIUS_PER_PITCH = 0.6; /* gives the height differences of Wu, Chiu 2024, eq. 19 */

/* Cell number `place` of the grid in an order of drops. */
static size_t cell_at(size_t place, size_t nx, size_t ny, int64_t order) {
    if (order == COLUMNS)
        return place % nx * ny + place / nx;
    if (order == SERPENTINE && place / ny % 2 == 1)
        return place + ny - 1 - 2 * (place % ny);
    return place;
}

static DropModel drop_model(const VolumeAreaDepositionVariables *v) {
    return (DropModel){.height_scale = *v->height_scale,
                       .mv_plus = *v->mv_plus,
                       .mv_minus = *v->mv_minus,
                       .ma_plus = *v->ma_plus,
                       .ma_minus = *v->ma_minus,
                       .cap = {{*v->cap_volume_middle, *v->cap_volume_side, *v->cap_volume_corner},
                               {*v->cap_area_middle, *v->cap_area_side, *v->cap_area_corner}},
                       .guard = *v->guard,
                       .limit_gains = *v->limit_gains};
}

/* Computes the shares of a drop on flat ground, once: they take longer than a drop. */
static void find_cap_shares(const VolumeAreaDepositionVariables *v) {
    const double radius = *v->cap_radius > 0.0 ? *v->cap_radius : CAP_RADIUS_PER_PITCH * *v->pitch;
    const CapShares cap = cap_shares(*v->height_scale, radius, *v->pitch);
    *v->cap_volume_middle = cap.volume[0];
    *v->cap_volume_side = cap.volume[1];
    *v->cap_volume_corner = cap.volume[2];
    *v->cap_area_middle = cap.area[0];
    *v->cap_area_side = cap.area[1];
    *v->cap_area_corner = cap.area[2];
}

/* Prints the captured droplets one after the other, each on the surface that the last one left. */
static void print_layer(Instance *instance, int32_t layer) {
    const VolumeAreaDepositionVariables v = volume_area_deposition_variables(instance);
    const LayerHandshake handshake = LAYER_HANDSHAKE(v);
    const VolumeVariation variation = VOLUME_VARIATION(v);
    const Passes passes = {*v.passes, *v.pass_order, *v.pass_rotation};
    const DropModel drop = drop_model(&v);
    const InkMap map = {v.height_start, v.height, v.area, (size_t)*v.nx, (size_t)*v.ny};
    draw_volumes(&handshake, &variation, layer, v.factor);
    for (int pass = 0; pass < passes.passes; pass++) {
        const int colour = pass_colour(&passes, layer, pass);
        for (size_t place = 0; place < map.nx * map.ny; place++) {
            const size_t cell = cell_at(place, map.nx, map.ny, *v.drop_order);
            const size_t i = cell / map.ny, j = cell % map.ny;
            if (v.captured[cell] != 0 && (colour == COLOUR_ALL || colour == cell_colour(i, j)))
                add_drop(&map, i, j, &drop, v.factor[cell]);
        }
    }
}

static Outcome check_value(Instance *instance, size_t variable, const void *value) {
    return variable == VOLUME_AREA_DEPOSITION_PASSES ? check_passes(instance, *(const int32_t *)value) : ACCEPTED;
}

static void calculate(Instance *instance) {
    const VolumeAreaDepositionVariables v = volume_area_deposition_variables(instance);
    const LayerHandshake handshake = LAYER_HANDSHAKE(v);
    handshake_calculate(&handshake);
    memset(v.area, 0, cell_count(&handshake) * sizeof *v.area);
    *v.volume_lost = 0.0;
}

static Outcome initialize(Instance *instance) {
    const VolumeAreaDepositionVariables v = volume_area_deposition_variables(instance);
    const Outcome outcome = handshake_initialize(instance, &LAYER_HANDSHAKE(v));
    if (outcome == ACCEPTED) {
        calculate(instance);
        find_cap_shares(&v);
    }
    return outcome;
}

static Outcome do_step(Instance *instance, double start, double end) {
    const VolumeAreaDepositionVariables v = volume_area_deposition_variables(instance);
    return handshake_do_step(instance, &LAYER_HANDSHAKE(v), start, end, print_layer);
}

const Model VOLUME_AREA_DEPOSITION = {.table = &VOLUME_AREA_DEPOSITION_VARIABLES,
                                      .check_value = check_value,
                                      .calculate = calculate,
                                      .initialize = initialize,
                                      .do_step = do_step};
