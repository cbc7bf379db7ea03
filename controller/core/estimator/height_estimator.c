#include "height_estimator.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dead_cells.h"
#include "estimate_doubts.h"
#include "layer_surface.h"
#include "scan_drift.h"

static const double UNSURE = 0.13;  /* of a layer: error of a growth that shows neither ink nor dead cells (by trial) */
static const double SURPRISE = 5.0; /* standard deviations off the prediction from which on the model of a cell is
                                       wrong, not the scan (by trial) */
static const double HALF = 0.5;     /* of the part */

/* Maps of one layer, and room for what others do with them. */
typedef struct {
    double *scan, *growth, *known, *spread, *total; /* total: spread and noise of a reading */
    double *predicted, *gain;
    DropletIncrements increments, flat;
    RegisteredScan registered;
    double *scratch; /* DRIFT_MAPS maps */
    uint8_t *marks;  /* two maps */
    void *memory;
} Workspace;

static bool workspace_open(Workspace *work, size_t cells, size_t inks) {
    const size_t rates = inks * ORDERS, maps = 15 + 2 * (rates + 2) + DRIFT_MAPS;
    RegisteredScan *registered = &work->registered;
    double *next = calloc(cells, maps * sizeof(double) + 4);
    work->memory = next;
    if (!next)
        return false;
    double **single[] = {&work->scan,       &work->growth,        &work->known, &work->spread,
                         &work->total,      &work->predicted,     &work->gain,  &registered->before,
                         &registered->scan, &registered->variance};
    for (size_t k = 0; k < sizeof single / sizeof *single; k++, next += cells)
        *single[k] = next;
    DropletIncrements *both[] = {&work->increments, &work->flat};
    for (size_t k = 0; k < 2; k++, next += (rates + 2) * cells)
        *both[k] = (DropletIncrements){next, next + rates * cells, next + (rates + 1) * cells};
    registered->sensitivity = next;
    registered->slopes = next + DISPLACEMENTS * cells;
    work->scratch = next + 5 * cells;
    work->marks = (uint8_t *)(work->scratch + DRIFT_MAPS * cells);
    registered->seen = work->marks + 2 * cells;
    registered->clear = work->marks + 3 * cells;
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
        displaced_scan(nx, ny, work->predicted, expected_displacement(&before->registration), work->scratch,
                       work->total);
        known = work->total;
    }
    const ScanDrift drift = scan_drift(nx, ny, options->part, work->scan, known, valid, work->scratch);
    for (size_t cell = 0; cell < nx * ny; cell++)
        work->scan[cell] -= drift_at(&drift, nx, ny, cell);
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
    for (size_t cell = 0; cell < cells; cell++) /* only the second scan shows what the first was worth */
        work->known[cell] = is_second && before->unseen[cell] == 0 ? *noise : before->variance[cell];
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
        take_as_read(&evidence, &work->registered);
        return true;
    }
    droplet_increments(layer, before->height, inks, before->ink, work->scratch, &work->increments);
    for (size_t cell = 0; cell < cells; cell++)
        work->spread[cell] = work->known[cell] + DROPLET_STD * DROPLET_STD * work->increments.squares[cell];
    return register_scan(&evidence, &after->registration, &work->registered);
}

/* The ink after a scan; its increments are those of `widths`. */
static void take_ink(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                     double noise, const Workspace *work, SurfaceEstimate *after, Ink widths[INKS_MAX]) {
    const RegisteredScan *scan = &work->registered;
    for (size_t cell = 0; cell < options->nx * options->ny; cell++)
        work->growth[cell] = scan->scan[cell] - scan->before[cell];
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
                                .scratch = work->scratch,
                                .predicted = work->predicted,
                                .marks = work->marks};
    learn_ink(&options->ink, &before->learnt, &learnt, DROPLET_STD, &after->learnt, after->ink, widths);
}

/* Kalman correction of a cell that was seen; returns its gain. */
static double correct(double predicted, double spread, double scan, double noise, double *height, double *variance) {
    const double surprise = (scan - predicted) * (scan - predicted);
    if (noise == 0.0) {
        *height = scan;
        *variance = 0.0;
        return 1.0;
    }
    const double wide = surprise > SURPRISE * SURPRISE * (spread + noise) ? surprise : spread;
    const double gain = wide / (wide + noise);
    *height = predicted + gain * (scan - predicted);
    *variance = (1.0 - gain) * wide;
    return gain;
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
        free(work.memory);
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
    for (size_t cell = 0; cell < cells; cell++) {
        after->height[cell] = work.predicted[cell];
        after->variance[cell] = work.spread[cell];
        after->unseen[cell] = scan->seen[cell] ? 0 : before->unseen[cell] + 1;
        if (scan->seen[cell])
            work.gain[cell] = correct(work.predicted[cell], work.spread[cell], scan->scan[cell],
                                      noise + scan->variance[cell], &after->height[cell], &after->variance[cell]);
    }
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
    free(work.memory);
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
    double *memory = calloc(cells, 4 * sizeof(double) + 2 * sizeof(int32_t));
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
    free(memory);
    return is_done;
}
