/* The surface that a layer is expected to leave, its variance, and its slopes. */
#include <math.h>
#include <string.h>

#include "map_memory.h"
#include "scan_fit.h"

static const double NO_VOLUME = 1e-12; /* of a droplet of a dead nozzle */

/* Allocates all maps, `averaged` and `spread_slope` next to each other as scratch of two. */
static bool take_memory(ScanEvidence *evidence) {
    const EstimatorOptions *options = evidence->options;
    const size_t cells = options->nx * options->ny;
    const Ink *unit = options->ink.model == INK_FULL ? NULL : options->ink.nominal;
    DropletIncrements *increments = &evidence->increments;
    double **const map[] = {&evidence->predicted, &evidence->variance,     &evidence->full_own,  &evidence->scan,
                            &evidence->slopes,    &evidence->factor,       &increments->squares, &increments->own,
                            &evidence->averaged,  &evidence->spread_slope, &evidence->lists[0],  &evidence->lists[1],
                            &increments->adds};
    const size_t reals = sizeof map / sizeof *map - 1 + options->ink.inks * maps_of_ink(unit);
    double *memory = take_raw_maps(cells, reals * sizeof(double) + 4);
    if (!memory)
        return false;
    evidence->memory = memory;
    increments->unit = unit;
    for (size_t k = 0; k < sizeof map / sizeof *map; k++)
        *map[k] = memory + k * cells;
    evidence->ground = (uint8_t *)(memory + reals * cells);
    evidence->walls = evidence->ground + cells;
    evidence->marks = evidence->walls + cells;
    return true;
}

enum { OF_DEAD, OF_INKS }; /* counts of droplets */

/* Volumes of droplets without those from dead nozzles, and the variances before the layer. */
static void keep_living_droplets(void *context, const RowRange *range) {
    const ScanEvidence *evidence = context;
    const JettedLayer *layer = &evidence->living;
    CellSums sums = {.count = {0}};
    Ink ink[INKS_MAX];
    learnt_inks(evidence->options, evidence->known, ink);
    for (size_t cell = range->top * layer->ny; cell < range->bottom * layer->ny; cell++) {
        const int32_t kind = layer->pattern[cell];
        const double volume = layer->factor ? layer->factor[cell] : 1.0;
        const bool is_dead = evidence->before->dead_evidence[cell] >= DEAD_EVIDENCE;
        evidence->full_own[cell] = kind > 0 ? volume * ink[kind - 1].h1 : 0.0;
        evidence->factor[cell] = is_dead ? NO_VOLUME : volume;
        evidence->variance[cell] = evidence->before->variance[cell];
        sums.count[OF_DEAD] += is_dead && kind > 0;
        for (int32_t k = 0; k < INKS_MAX; k++)
            sums.count[OF_INKS + k] += kind == k + 1;
    }
    evidence->sums[range->chunk] = sums;
}

static void take_half(const EstimatorOptions *options, const double *before, ScanEvidence *evidence) {
    const DropletIncrements *increments = &evidence->increments;
    const size_t cells = options->nx * options->ny;
    for (size_t cell = 0; cell < cells; cell++) {
        const double whole = evidence->predicted[cell] - before[cell];
        evidence->predicted[cell] = before[cell] + 0.5 * whole;
        evidence->variance[cell] += whole * whole / 12.0;
        increments->squares[cell] = increments->own[cell] = 0.0;
    }
    memset(increments->adds, 0, options->ink.inks * maps_of_ink(increments->unit) * cells * sizeof(double));
}

static void take_slopes(void *context, const RowRange *range) {
    const ScanEvidence *evidence = context;
    const size_t nx = evidence->nx, ny = evidence->ny;
    for (size_t i = range->top; i < range->bottom; i++) {
        const double *here = evidence->predicted + i * ny;
        const double *up = i > 0 ? here - ny : here, *down = i + 1 < nx ? here + ny : here;
        double *restrict into = evidence->slopes + i * ny;
        for (size_t j = 0; j < ny; j++) {
            const double along_x = 0.5 * (down[j] - up[j]);
            const double along_y = 0.5 * (here[j + 1 < ny ? j + 1 : j] - here[j > 0 ? j - 1 : j]);
            into[j] = along_x * along_x + along_y * along_y;
        }
    }
}

bool predict_layer(ScanEvidence *evidence) {
    const EstimatorOptions *options = evidence->options;
    const SurfaceEstimate *before = evidence->before;
    Ink ink[INKS_MAX];
    if (!take_memory(evidence))
        return false;
    learnt_inks(options, evidence->known, ink);
    const CellSums droplets = over_rows(evidence, keep_living_droplets, evidence);
    evidence->part = count_marked(options->part, evidence->cells);
    for (size_t k = 0; k < INKS_MAX; k++)
        evidence->printed[k] = fmin((double)droplets.count[OF_INKS + k] / fmax((double)evidence->part, 1.0), 1.0);
    if (droplets.count[OF_DEAD] > 0)
        evidence->living.factor = evidence->factor;
    droplet_increments(&evidence->living, before->height, options->ink.inks, ink, evidence->averaged,
                       &evidence->increments, evidence->predicted);
    if (evidence->is_unknown)
        take_half(options, before->height, evidence);
    over_rows(evidence, take_slopes, evidence);
    return true;
}
