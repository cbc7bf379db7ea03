#include "droplet_volume.h"

#include "random.h"

double droplet_volume(const VolumeVariation *how, double nominal, size_t ny, size_t cell, int32_t layer) {
    const double amplitude = how->variation;
    double volume = nominal;
    if (amplitude > 0.0) {
        if (how->kind == PER_DROPLET)
            volume *= 1.0 - amplitude * random_uniform(how->seed, STREAM_DROPLET, cell, layer);
        if (how->kind == PER_CELL || how->kind == PER_CELL_AND_LAYER)
            volume *= 1.0 - amplitude * random_uniform(how->seed, STREAM_CELL, cell, 0);
        if (how->kind == PER_LAYER || how->kind == PER_CELL_AND_LAYER)
            volume *= 1.0 - amplitude * random_uniform(how->seed, STREAM_LAYER, 0, layer);
    }
    if (how->nozzle_variation > 0.0) {
        const uint64_t nozzle = cell % ny % (uint64_t)how->nozzle_pitch;
        volume *= 1.0 - how->nozzle_variation * random_uniform(how->seed, STREAM_NOZZLE, nozzle, 0);
    }
    return volume;
}
