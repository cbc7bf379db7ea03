#include "inkloop_models.h"

#include "cap_footprint.h"
#include "layer_map.h"

#include <stdlib.h>

int32_t inkloop_models_interface(void) {
    return MODELS_INTERFACE;
}

void inkloop_droplet_volumes(size_t nx, size_t ny, const VolumeVariation *how, int32_t layer, double *volumes) {
    for (size_t cell = 0; cell < nx * ny; cell++)
        volumes[cell] = droplet_volume(how, 1.0, ny, cell, layer);
}

double inkloop_layer_pass(size_t nx, size_t ny, const double *before, double *after, const int32_t *pattern,
                          const FarInk ink[2], int32_t reach, const double *volume, int32_t colour) {
    const Ink near[2] = {{ink[0].h[0], ink[0].h[1], ink[0].h[2]}, {ink[1].h[0], ink[1].h[1], ink[1].h[2]}};
    return reach == 1 ? deposit_pass(before, after, nx, ny, pattern, near, volume, colour)
                      : deposit_far_pass(before, after, nx, ny, pattern, ink, reach, volume, colour);
}

double inkloop_caps(size_t nx, size_t ny, double *height, const int32_t *pattern, const SphericalCap cap[2],
                    double pitch, const double *volume) {
    const CapFootprint footprint[2] = {cap_footprint(&cap[0], pitch), cap_footprint(&cap[1], pitch)};
    double lost = 0.0;
    for (size_t cell = 0; cell < nx * ny; cell++)
        if (pattern[cell] != 0)
            lost += add_cap(height, nx, ny, cell / ny, cell % ny, &footprint[pattern[cell] - 1], volume[cell]);
    return lost;
}

int32_t inkloop_cap_reach_max(void) {
    return MOST_REACH;
}

void inkloop_cap_shares(double height_scale, double base_radius, double pitch, CapShares *shares) {
    *shares = cap_shares(height_scale, base_radius, pitch);
}

void inkloop_add_drops(const InkMap *map, const DropModel *drop, const size_t *cells, size_t count,
                       const double *volume) {
    for (size_t k = 0; k < count; k++)
        add_drop(map, cells[k] / map->ny, cells[k] % map->ny, drop, volume[cells[k]]);
}

double inkloop_base_radius(double volume, double contact_angle) {
    return cap_radius(volume, contact_angle);
}

void inkloop_fine_size(const FineSurface *surface, size_t *columns, size_t *rows, size_t *rim) {
    *columns = column_count(surface);
    *rows = row_count(surface);
    *rim = rim_points(surface);
}

void inkloop_spread_cells(const FineSurface *surface, const double *cells) {
    spread_cells(surface, cells);
}

void inkloop_mean_cells(const FineSurface *surface, double *cells) {
    mean_cells(surface, cells);
}

int32_t inkloop_print_lines(const FineSurface *surface, const Liquid *liquid, const double *drops, size_t line,
                            size_t every, double *lost) {
    PassMemory memory;
    void *block = malloc(place_pass_memory(surface, NULL, &memory));
    if (!block)
        return MODELS_NO_MEMORY;
    place_pass_memory(surface, block, &memory);
    const PassReport report = print_pass(surface, liquid, drops, line, every, &memory);
    free(block);
    *lost = report.lost;
    return report.fallbacks;
}
