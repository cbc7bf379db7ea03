#include "cap_footprint.h"
#include "layer_handshake.h"
#include "superposition_deposition_variables.h"

/* Adds the cap of every captured droplet to the surface, whatever its height. */
static void print_layer(Instance *instance, int32_t layer) {
    const SuperpositionDepositionVariables v = superposition_deposition_variables(instance);
    const LayerHandshake handshake = LAYER_HANDSHAKE(v);
    const VolumeVariation variation = VOLUME_VARIATION(v);
    const SphericalCap cap[2] = {{*v.cap_radius_a, *v.cap_height_a}, {*v.cap_radius_b, *v.cap_height_b}};
    const CapFootprint footprint[2] = {cap_footprint(&cap[0], *v.pitch), cap_footprint(&cap[1], *v.pitch)};
    const size_t nx = (size_t)*v.nx, ny = (size_t)*v.ny;
    draw_volumes(&handshake, &variation, layer, v.factor);
    double lost = 0.0;
    for (size_t cell = 0; cell < nx * ny; cell++)
        if (v.captured[cell] != 0)
            lost += add_cap(v.height, nx, ny, cell / ny, cell % ny, &footprint[v.captured[cell] - 1], v.factor[cell]);
    *v.volume_lost += lost * *v.pitch * *v.pitch;
}

static Outcome check_cap(Instance *instance, const char *material, double radius, double height, double pitch) {
    if (height > radius)
        return refuse(instance,
                      "cap_height_%s is %g m on a cap_radius_%s of %g m; expected at most the radius, which is a "
                      "contact angle of 90 degrees",
                      material, height, material, radius);
    if (cap_reach(radius, pitch) > MOST_REACH)
        return refuse(instance, "cap_radius_%s is %g m on a pitch of %g m; expected at most %g m, %g pitches", material,
                      radius, pitch, (MOST_REACH + 0.5) * pitch, MOST_REACH + 0.5);
    return ACCEPTED;
}

static void calculate(Instance *instance) {
    const SuperpositionDepositionVariables v = superposition_deposition_variables(instance);
    handshake_calculate(&LAYER_HANDSHAKE(v));
    *v.volume_lost = 0.0;
}

static Outcome initialize(Instance *instance) {
    const SuperpositionDepositionVariables v = superposition_deposition_variables(instance);
    Outcome outcome = check_cap(instance, "a", *v.cap_radius_a, *v.cap_height_a, *v.pitch);
    if (outcome == ACCEPTED)
        outcome = check_cap(instance, "b", *v.cap_radius_b, *v.cap_height_b, *v.pitch);
    if (outcome == ACCEPTED)
        outcome = handshake_initialize(instance, &LAYER_HANDSHAKE(v));
    if (outcome == ACCEPTED)
        calculate(instance);
    return outcome;
}

static Outcome do_step(Instance *instance, double start, double end) {
    const SuperpositionDepositionVariables v = superposition_deposition_variables(instance);
    return handshake_do_step(instance, &LAYER_HANDSHAKE(v), start, end, print_layer);
}

const Model SUPERPOSITION_DEPOSITION = {
    .table = &SUPERPOSITION_DEPOSITION_VARIABLES, .calculate = calculate, .initialize = initialize, .do_step = do_step};
