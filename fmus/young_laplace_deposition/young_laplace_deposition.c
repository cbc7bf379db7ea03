#include "layer_handshake.h"
#include "line_pass.h"
#include "passes.h"
#include "young_laplace_deposition_variables.h"

#include <string.h>

/* The fine surface without its heights. */
static FineSurface sized_surface(const YoungLaplaceDepositionVariables *v) {
    return (FineSurface){.nx = (size_t)*v->nx,
                         .ny = (size_t)*v->ny,
                         .per_pitch = (size_t)*v->cells_per_pitch,
                         .spacing = *v->pitch / *v->cells_per_pitch};
}

/* The fine surface that the instance keeps; its heights are NULL if there is no memory. */
static FineSurface kept_surface(Instance *instance, const YoungLaplaceDepositionVariables *v) {
    FineSurface surface = sized_surface(v);
    surface.height = kept_memory(instance, column_count(&surface) * row_count(&surface) * sizeof *surface.height);
    return surface;
}

static void print_layer(Instance *instance, int32_t layer) {
    const YoungLaplaceDepositionVariables v = young_laplace_deposition_variables(instance);
    const LayerHandshake handshake = LAYER_HANDSHAKE(v);
    const VolumeVariation variation = VOLUME_VARIATION(v);
    const Passes passes = {*v.passes, *v.pass_order, *v.pass_rotation};
    const Liquid liquid = {*v.droplet_volume, *v.contact_angle, (SurfaceForm)*v.form};
    const FineSurface surface = kept_surface(instance, &v);
    PassMemory memory;
    place_pass_memory(&surface, scratch_memory(instance, place_pass_memory(&surface, NULL, &memory)), &memory);
    memset(v.drops, 0, cell_count(&handshake) * sizeof *v.drops);
    draw_volumes(&handshake, &variation, layer, v.drops);
    for (int pass = 0; pass < passes.passes; pass++) {
        const int colour = pass_colour(&passes, layer, pass); /* of four: here a line modulo 4 */
        const PassReport report =
            print_pass(&surface, &liquid, v.drops, colour < 0 ? 0 : (size_t)colour, colour < 0 ? 1 : COLOURS, &memory);
        *v.fallbacks += report.fallbacks;
        *v.volume_lost += report.lost;
    }
    mean_cells(&surface, v.height);
}

/* Checks droplets of so many drops against the rim of the fine surface and the distance of the lines of a pass. */
static Outcome check_spread(Instance *instance, const YoungLaplaceDepositionVariables *v, double drops,
                            const char *whose) {
    const double radius = cap_radius(drops * *v->droplet_volume, *v->contact_angle);
    if (radius <= WIDEST_SPREAD * *v->pitch)
        return ACCEPTED;
    return refuse(instance,
                  "%s spreads to a radius of %g m on level ground, with %g drops of %g m3 at %g rad; expected at most "
                  "%d pitches, %g m",
                  whose, radius, drops, *v->droplet_volume, *v->contact_angle, WIDEST_SPREAD,
                  WIDEST_SPREAD * *v->pitch);
}

/* Checks the largest droplet of the layer that a step may accept at its begin. */
static Outcome check_largest_droplet(Instance *instance, const YoungLaplaceDepositionVariables *v) {
    int32_t most = 0;
    for (size_t cell = 0; cell < (size_t)(*v->nx * *v->ny); cell++)
        if (v->pattern[cell] != 0 && v->drop_level[cell] > most)
            most = v->drop_level[cell];
    return check_spread(instance, v, most * *v->volume_factor, "the largest droplet of the pattern");
}

static Outcome lack_memory(Instance *instance, const FineSurface *surface, size_t size) {
    return refuse(instance,
                  "no memory for %llu x %llu points of the fine surface, %llu a cell, and %llu bytes to solve on it; "
                  "expected fewer cells_per_pitch or a smaller grid",
                  (unsigned long long)column_count(surface), (unsigned long long)row_count(surface),
                  (unsigned long long)(surface->per_pitch * surface->per_pitch), (unsigned long long)size);
}

/* Allocates the memory that layers need with the present cells_per_pitch. Only `find_memory` divides it: kept memory
 * counts in a saved state. */
static Outcome reserve(Instance *instance) {
    const YoungLaplaceDepositionVariables v = young_laplace_deposition_variables(instance);
    const FineSurface surface = sized_surface(&v);
    PassMemory memory;
    const size_t size = place_pass_memory(&surface, NULL, &memory);
    const size_t heights = column_count(&surface) * row_count(&surface) * sizeof *surface.height;
    return scratch_memory(instance, size + heights) ? ACCEPTED : lack_memory(instance, &surface, size);
}

/* Finds the memory that layers need in addition to the variables; a restored state includes its fine surface. */
static Outcome find_memory(Instance *instance, const YoungLaplaceDepositionVariables *v) {
    const FineSurface surface = kept_surface(instance, v);
    PassMemory memory;
    const size_t size = place_pass_memory(&surface, NULL, &memory);
    return surface.height && scratch_memory(instance, size) ? ACCEPTED : lack_memory(instance, &surface, size);
}

static Outcome check_value(Instance *instance, size_t variable, const void *value) {
    return variable == YOUNG_LAPLACE_DEPOSITION_PASSES ? check_passes(instance, *(const int32_t *)value) : ACCEPTED;
}

static void calculate(Instance *instance) {
    const YoungLaplaceDepositionVariables v = young_laplace_deposition_variables(instance);
    handshake_calculate(&LAYER_HANDSHAKE(v));
    *v.volume_lost = 0.0;
    *v.fallbacks = 0;
}

static Outcome initialize(Instance *instance) {
    const YoungLaplaceDepositionVariables v = young_laplace_deposition_variables(instance);
    Outcome outcome = check_spread(instance, &v, 1.0, "a droplet");
    if (outcome == ACCEPTED)
        outcome = handshake_initialize(instance, &LAYER_HANDSHAKE(v));
    if (outcome == ACCEPTED) { /* last: the size of a saved state follows from it */
        scratch_memory(instance, 0);
        outcome = find_memory(instance, &v);
    }
    if (outcome != ACCEPTED)
        return outcome;
    calculate(instance);
    const FineSurface surface = kept_surface(instance, &v);
    spread_cells(&surface, v.height_start);
    return ACCEPTED;
}

static Outcome do_step(Instance *instance, double start, double end) {
    const YoungLaplaceDepositionVariables v = young_laplace_deposition_variables(instance);
    Outcome outcome = find_memory(instance, &v);
    if (outcome == ACCEPTED && (*v.layer_command != *v.reference || *v.layer_period > 0.0))
        outcome = check_largest_droplet(instance, &v);
    return outcome == ACCEPTED ? handshake_do_step(instance, &LAYER_HANDSHAKE(v), start, end, print_layer) : outcome;
}

const Model YOUNG_LAPLACE_DEPOSITION = {.table = &YOUNG_LAPLACE_DEPOSITION_VARIABLES,
                                        .reserve = reserve,
                                        .check_value = check_value,
                                        .calculate = calculate,
                                        .initialize = initialize,
                                        .do_step = do_step};
