#include "layer_prediction.h"

#include <math.h>
#include <string.h>

#include "map_memory.h"

static const double NO_VOLUME = 1e-12; /* of a droplet of a dead nozzle */

/* Allocates all maps, `averaged` and `spread_slope` next to each other as scratch of two; `factor` holds the volumes of
 * living droplets. */
static bool take_memory(const EstimatorOptions *options, LayerMaps *maps, double **factor) {
    const size_t cells = options->nx * options->ny;
    const Ink *unit = options->ink.model == INK_FULL ? NULL : options->ink.nominal;
    DropletIncrements *increments = &maps->increments;
    FitRoom *room = &maps->room;
    double **const map[] = {
        &maps->predicted, &maps->variance,      &maps->full_own,  &maps->scan,     &maps->slopes,
        factor,           &increments->squares, &increments->own, &room->averaged, &room->spread_slope,
        &room->lists[0],  &room->lists[1],      &increments->adds};
    const size_t reals = sizeof map / sizeof *map - 1 + options->ink.inks * maps_of_ink(unit);
    double *memory = take_raw_maps(cells, reals * sizeof(double) + 4);
    if (!memory)
        return false;
    maps->memory = memory;
    increments->unit = unit;
    for (size_t k = 0; k < sizeof map / sizeof *map; k++)
        *map[k] = memory + k * cells;
    maps->ground = (uint8_t *)(memory + reals * cells);
    room->walls = maps->ground + cells;
    room->marks = room->walls + cells;
    return true;
}

/* The layer without droplets from dead nozzles, with their volumes in `factor`; `full_own`: height that each cell's
 * droplet would leave on it, dead nozzles included. */
static JettedLayer living_droplets(const EstimatorOptions *options, const SurfaceEstimate *before,
                                   const JettedLayer *layer, const Ink ink[], double *factor, double *full_own) {
    JettedLayer living = *layer;
    bool has_dead = false;
    for (size_t cell = 0; cell < options->nx * options->ny; cell++) {
        const int32_t kind = layer->pattern[cell];
        const double volume = layer->factor ? layer->factor[cell] : 1.0;
        const bool is_dead = before->dead_evidence[cell] >= DEAD_EVIDENCE;
        full_own[cell] = kind > 0 ? volume * ink[kind - 1].h1 : 0.0;
        factor[cell] = is_dead ? NO_VOLUME : volume;
        has_dead |= is_dead && kind > 0;
    }
    if (has_dead)
        living.factor = factor;
    return living;
}

bool predict_layer(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   bool is_unknown, LayerMaps *maps) {
    const size_t cells = options->nx * options->ny;
    DropletIncrements *increments = &maps->increments;
    Ink ink[INKS_MAX];
    double *factor;
    if (!take_memory(options, maps, &factor))
        return false;
    learnt_inks(options, before->known, ink);
    maps->living = living_droplets(options, before, layer, ink, factor, maps->full_own);
    droplet_increments(&maps->living, before->height, options->ink.inks, ink, maps->room.averaged, increments,
                       maps->predicted);
    memcpy(maps->variance, before->variance, cells * sizeof(double));
    if (!is_unknown)
        return true;
    for (size_t cell = 0; cell < cells; cell++) {
        const double whole = maps->predicted[cell] - before->height[cell];
        maps->predicted[cell] = before->height[cell] + 0.5 * whole;
        maps->variance[cell] += whole * whole / 12.0;
        increments->squares[cell] = increments->own[cell] = 0.0;
    }
    memset(increments->adds, 0, options->ink.inks * maps_of_ink(increments->unit) * cells * sizeof(double));
    return true;
}
