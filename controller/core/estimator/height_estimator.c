#include "height_estimator.h"

#include <math.h>
#include <string.h>

#include "dead_cells.h"
#include "estimate_doubts.h"
#include "layer_surface.h"
#include "map_memory.h"
#include "scan_drift.h"

static const double UNSURE = 0.13;  /* of a layer: error of a growth that shows neither ink nor dead cells (by trial) */
static const double SURPRISE = 5.0; /* standard deviations off the prediction from which on the model of a cell is
                                       wrong, not the scan (by trial) */
static const double HALF = 0.5;     /* of the part */

/* Maps of one layer, and room for what others do with them. */
typedef struct {
    double *scan, *growth, *spread, *total; /* total: spread and noise of a reading */
    double *predicted, *gain;
    double *known_room;  /* a map for `known`, */
    const double *known; /* which is often that of the estimate before: variance of its heights */
    DropletIncrements increments, flat;
    RegisteredScan registered;
    CorrectedMaps corrected;
    Room room;
    double *scratch; /* DRIFT_MAPS maps */
    uint8_t *marks;  /* two maps */
    void *memory;
} Workspace;

/* The next maps of the memory. */
static double *next_maps(double **next, size_t count, size_t cells) {
    double *maps = *next;
    *next += count * cells;
    return maps;
}

/* The maps of the registration, by those whose turn comes after it; is_wall: a map. */
static Room room_in(const Workspace *work, double *columns, uint8_t *is_wall, size_t cells) {
    Room room = {.surface = work->total,
                 .growth = work->growth,
                 .displaced_growth = work->flat.rates,
                 .weight = work->gain,
                 .rest = work->flat.rates + cells,
                 .curvature = work->flat.rates + 2 * cells,
                 .scratch = work->scratch,
                 .is_wall = is_wall};
    for (size_t k = 0; k < GROWTH; k++)
        room.columns[k] = columns + k * cells;
    return room;
}

static bool workspace_open(Workspace *work, size_t cells, size_t inks) {
    const size_t rates = inks * ORDERS, maps = 10 + 2 * rates + 2 + GROWTH + DRIFT_MAPS;
    double *next = take_maps(cells, maps * sizeof(double) + 5);
    work->memory = next;
    if (!next)
        return false;
    double **single[] = {
        &work->scan, &work->growth,     &work->spread,           &work->total,          &work->predicted,
        &work->gain, &work->known_room, &work->corrected.before, &work->corrected.scan, &work->corrected.variance};
    for (size_t k = 0; k < sizeof single / sizeof *single; k++)
        *single[k] = next_maps(&next, 1, cells);
    work->increments.rates = next_maps(&next, rates, cells);
    work->increments.squares = next_maps(&next, 1, cells);
    work->increments.own = next_maps(&next, 1, cells);
    work->flat.rates = next_maps(&next, rates, cells);
    double *columns = next_maps(&next, GROWTH, cells);
    work->scratch = next_maps(&next, DRIFT_MAPS, cells);
    work->marks = (uint8_t *)next;
    work->corrected.seen = work->marks + 2 * cells;
    work->corrected.clear = work->marks + 3 * cells;
    work->room = room_in(work, columns, work->marks + 4 * cells, cells);
    return true;
}

static bool registers(const EstimatorOptions *options) {
    return !options->take_as_read && options->register_scans;
}

bool estimate_first(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                    SurfaceEstimate *estimate) {
    const double noise = fmax(options->noise_variance, 0.0);
    const size_t cells = options->nx * options->ny;
    for (size_t cell = 0; cell < cells; cell++) {
        estimate->height[cell] = valid[cell] ? measured[cell] : 0.0;
        estimate->variance[cell] = valid[cell] ? noise : options->first_variance;
        estimate->unseen[cell] = valid[cell] ? 0 : 1;
        estimate->dead_evidence[cell] = 0.0;
    }
    memset(estimate->response, 0, DISPLACEMENTS * cells * sizeof(double));
    memcpy(estimate->ink, options->ink.nominal, sizeof estimate->ink);
    estimate->learnt = (InkKnowledge){0};
    estimate->registration = no_registration();
    estimate->trust = full_trust();
    begin_trust(options, layer, measured, valid, estimate);
    estimate->noise_variance = noise;
    estimate->scans = 1;
    return !registers(options) || first_response(options->nx, options->ny, estimate->height, valid, estimate->response);
}

/* Variance of a reading [m^2]: as given, or the mean over the scans of what the unprinted cells show. */
static double reading_noise(const EstimatorOptions *options, const SurfaceEstimate *before, double residual_variance) {
    if (options->noise_variance >= 0.0)
        return options->noise_variance;
    if (residual_variance < 0.0)
        return fmax(before->noise_variance, options->steps_variance);
    const double weight = 1.0 / (double)before->scans;
    const double of_reading = residual_variance / (1.0 + weight); /* the known heights have been averaged so often */
    return fmax((1.0 - weight) * before->noise_variance + weight * of_reading, options->steps_variance);
}

/* Takes the drift out of the scan in `work`; returns the variance of its readings. */
static double level_scan(const EstimatorOptions *options, const SurfaceEstimate *before, const uint8_t *valid,
                         const Workspace *work) {
    const size_t nx = options->nx, ny = options->ny;
    const double *known = before->height;
    if (is_displaced(&before->registration)) { /* walls reach further in such a scan */
        const Patch grid = {0, nx, 0, ny};
        const DisplacedView view = displaced_view(expected_displacement(&before->registration));
        displaced_scan(nx, ny, work->predicted, &view, &grid, work->scratch, work->total);
        known = work->total;
    }
    const ScanDrift drift = scan_drift(nx, ny, options->part, work->scan, known, valid, work->scratch);
    take_drift_off(&drift, nx, ny, work->scan);
    return reading_noise(options, before, drift.residual_variance);
}

/* The scan in register; `noise`: variance of its readings. False if there is no memory. */
static bool take_scan(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                      bool is_unknown, const double *measured, const uint8_t *valid, Workspace *work,
                      SurfaceEstimate *after, double *noise) {
    const size_t cells = options->nx * options->ny, inks = options->ink.inks;
    const Ink both[2] = {before->ink[0], before->ink[inks - 1]};
    for (size_t cell = 0; cell < cells; cell++)
        work->scan[cell] = valid[cell] ? measured[cell] : 0.0;
    layer_surface(layer, before->height, both, work->scratch, work->predicted);
    *noise = options->take_as_read ? 0.0 : level_scan(options, before, valid, work);
    const bool is_second = before->scans == 1 && options->noise_variance < 0.0;
    work->known = is_second ? work->known_room : before->variance;
    for (size_t cell = 0; is_second && cell < cells; cell++) /* it shows what the first was worth */
        work->known_room[cell] = before->unseen[cell] == 0 ? *noise : before->variance[cell];
    after->registration = before->registration;
    const ScanEvidence evidence = {.nx = options->nx,
                                   .ny = options->ny,
                                   .before = before->height,
                                   .predicted = work->predicted,
                                   .spread = work->spread,
                                   .response = before->response,
                                   .scan = work->scan,
                                   .valid = valid,
                                   .part = options->part,
                                   .noise_variance = *noise,
                                   .unsure = UNSURE * full_layer_height(&options->ink.nominal[0]),
                                   .is_first_layer = before->scans == 1,
                                   .is_unknown = is_unknown,
                                   .has_spot = options->ink.model != INK_FULL};
    if (!registers(options)) {
        take_as_read(&evidence, &work->corrected, &work->registered);
        return true;
    }
    droplet_increments(layer, before->height, inks, before->ink, work->scratch, &work->increments);
    for (size_t cell = 0; cell < cells; cell++)
        work->spread[cell] = work->known[cell] + DROPLET_STD * DROPLET_STD * work->increments.squares[cell];
    return register_scan(&evidence, &work->corrected, &work->room, &after->registration, &work->registered);
}

/* The ink after a scan; its increments are those of `widths`. */
static void take_ink(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                     double noise, const Workspace *work, SurfaceEstimate *after, Ink widths[INKS_MAX]) {
    const RegisteredScan *scan = &work->registered;
    for (size_t cell = 0; cell < options->nx * options->ny; cell++)
        work->growth[cell] = scan->scan[cell] - scan->before[cell];
    Ink held[INKS_MAX] = {{0.0, 0.0, 0.0}};
    if (registers(options) && !is_displaced(&after->registration)) /* the registration has taken them */
        memcpy(held, before->ink, sizeof held);
    const LearntLayer learnt = {.layer = layer,
                                .part = options->part,
                                .clear = scan->clear,
                                .before = scan->before,
                                .scan = scan->scan,
                                .growth = work->growth,
                                .known = work->known,
                                .noise = noise,
                                .misread = scan->variance,
                                .spread = work->spread,
                                .total = work->total,
                                .increments = work->increments,
                                .flat = work->flat,
                                .held = held,
                                .scratch = work->scratch,
                                .predicted = work->predicted,
                                .marks = work->marks};
    learn_ink(&options->ink, &before->learnt, &learnt, DROPLET_STD, &after->learnt, after->ink, widths);
}

/* Kalman correction of the cells that were seen; leaves their gains, 0 for the others. */
static void correct(size_t cells, const double *predicted, const double *spread, const RegisteredScan *scan,
                    double noise, double *restrict gains, double *restrict height, double *restrict variance) {
    const double *reading = scan->scan, *misread = scan->variance;
    const uint8_t *seen = scan->seen;
    for (size_t cell = 0; cell < cells; cell++) {
        const double off = reading[cell] - predicted[cell], surprise = off * off, error = noise + misread[cell];
        const double known = spread[cell];
        const double wide = surprise > SURPRISE * SURPRISE * (known + error) ? surprise : known;
        const double share = wide / (wide + error), gain = error == 0.0 ? 1.0 : share;
        const double corrected = predicted[cell] + gain * off, left = (1.0 - gain) * wide;
        gains[cell] = seen[cell] ? gain : 0.0;
        height[cell] = seen[cell] ? (error == 0.0 ? reading[cell] : corrected) : predicted[cell];
        variance[cell] = seen[cell] ? (error == 0.0 ? 0.0 : left) : known;
    }
}

/* Which cells' droplets do not come, by the increments in the proportions of `ink`. */
static void find_dead(const EstimatorOptions *options, const SurfaceEstimate *before, const Ink ink[],
                      const Workspace *work, SurfaceEstimate *after) {
    const size_t cells = options->nx * options->ny;
    double *own = work->scratch, *grown = work->scratch + cells;
    size_t part_cells = 0;
    for (size_t cell = 0; cell < cells; cell++) {
        const double added = added_height(&work->increments, cells, cell, options->ink.inks, ink);
        own[cell] = work->registered.clear[cell] ? work->increments.own[cell] : 0.0;
        grown[cell] = work->growth[cell] - added + work->increments.own[cell];
        part_cells += options->part[cell] != 0;
    }
    dead_evidence(cells, before->dead_evidence, own, grown, work->total, part_cells, after->dead_evidence);
}

/* How well the prediction explains what the cells of the part grew by. */
static void look_at_growth(const EstimatorOptions *options, const JettedLayer *layer, const Workspace *work,
                           SurfaceEstimate *after) {
    const size_t cells = options->nx * options->ny;
    double *added = work->scratch, built = 0.0, wanted = 0.0;
    size_t part_cells = 0;
    for (size_t cell = 0; cell < cells; cell++) {
        part_cells += options->part[cell] != 0;
        added[cell] = work->predicted[cell] - work->registered.before[cell];
        work->marks[cell] = options->part[cell] && work->registered.clear[cell];
        built += options->part[cell] ? work->registered.before[cell] : 0.0;
        wanted += options->part[cell] ? options->target[cell] : 0.0;
    }
    const LayerGrowth growth = {cells,        part_cells, work->marks, layer->pattern,
                                work->growth, added,      work->total, built < HALF * wanted};
    double learnt = 0.0, nominal = 0.0;
    for (size_t k = 0; k < options->ink.inks; k++) {
        learnt += full_layer_height(&after->ink[k]);
        nominal += full_layer_height(&options->ink.nominal[k]);
    }
    if (!options->take_as_read)
        add_residuals(&growth, learnt / nominal, work->scratch + cells, &after->trust);
}

/* is_unknown: the displacement of the scan is not learnt from, as the other things are not by the caller. */
static bool estimate_after(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                           bool is_unknown, const double *measured, const uint8_t *valid, SurfaceEstimate *after) {
    const size_t cells = options->nx * options->ny, inks = options->ink.inks;
    Workspace work;
    Ink widths[INKS_MAX];
    double noise;
    if (!workspace_open(&work, cells, inks))
        return false;
    if (!take_scan(options, before, layer, is_unknown, measured, valid, &work, after, &noise)) {
        give_maps(work.memory);
        return false;
    }
    const RegisteredScan *scan = &work.registered;
    take_ink(options, before, layer, noise, &work, after, widths);
    find_dead(options, before, widths, &work, after);
    const Ink both[2] = {after->ink[0], after->ink[inks - 1]};
    layer_surface(layer, scan->before, both, work.scratch, work.predicted);
    after->trust = before->trust;
    after->trust.volume = 1.0;
    if (!is_unknown)
        look_at_growth(options, layer, &work, after);
    for (size_t cell = 0; cell < cells; cell++)
        after->unseen[cell] = scan->seen[cell] ? 0 : before->unseen[cell] + 1;
    correct(cells, work.predicted, work.spread, scan, noise, work.gain, after->height, after->variance);
    if (registers(options))
        carry_response(cells, scan, before->response, work.gain, after->response,
                       is_displaced(&after->registration) ? after->variance : NULL);
    else
        memset(after->response, 0, DISPLACEMENTS * cells * sizeof(double));
    after->noise_variance = noise;
    after->scans = before->scans + 1;
    layer_surface(layer, before->reckoned, both, work.scratch, after->reckoned);
    for (size_t cell = 0; cell < cells; cell++)
        after->reckoned[cell] =
            before->reckoned[cell] + after->trust.volume * (after->reckoned[cell] - before->reckoned[cell]);
    forgive_dead(options, before, work.marks, after);
    look_at_cells(options, valid, after);
    give_maps(work.memory);
    return true;
}

bool estimate_next(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   const double *measured, const uint8_t *valid, SurfaceEstimate *after) {
    return estimate_after(options, before, layer, false, measured, valid, after);
}

/* What is known before the scan of a layer of which any part may have been jetted; the maps of `begun` are its own. */
static void expect_anything(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                            double *scratch, SurfaceEstimate *begun) {
    const Ink both[2] = {before->ink[0], before->ink[options->ink.inks - 1]};
    layer_surface(layer, before->height, both, scratch, begun->height);
    layer_surface(layer, before->reckoned, both, scratch, begun->reckoned);
    for (size_t cell = 0; cell < options->nx * options->ny; cell++) {
        const double whole = begun->height[cell] - before->height[cell];
        begun->height[cell] = before->height[cell] + 0.5 * whole;
        begun->reckoned[cell] = 0.5 * (before->reckoned[cell] + begun->reckoned[cell]);
        begun->variance[cell] = before->variance[cell] + whole * whole / 12.0;
        begun->unseen[cell] = before->unseen[cell];
        if (before->scans == 1 && whole != 0.0 && begun->unseen[cell] < 1)
            begun->unseen[cell] = 1; /* or the first scan, of another height, would set the variance */
    }
}

bool estimate_unknown(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                      const double *measured, const uint8_t *valid, SurfaceEstimate *after) {
    const size_t cells = options->nx * options->ny;
    double *memory = take_maps(cells, 4 * sizeof(double) + 2 * sizeof(int32_t));
    if (!memory)
        return false;
    SurfaceEstimate begun = *before;
    begun.height = memory;
    begun.variance = memory + cells;
    begun.reckoned = memory + 2 * cells;
    begun.unseen = (int32_t *)(memory + 4 * cells);
    expect_anything(options, before, layer, memory + 3 * cells, &begun);
    const JettedLayer nothing = {layer->nx, layer->ny, begun.unseen + cells, NULL, layer->passes, layer->order};
    const bool is_done = estimate_after(options, &begun, &nothing, true, measured, valid, after);
    memcpy(after->ink, before->ink, sizeof after->ink);
    memcpy(after->dead_evidence, before->dead_evidence, cells * sizeof(double));
    after->learnt = before->learnt;
    give_maps(memory);
    return is_done;
}
