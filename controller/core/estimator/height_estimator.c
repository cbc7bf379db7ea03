#include "height_estimator.h"

#include <math.h>
#include <string.h>

#include "displacement_response.h"
#include "estimate_doubts.h"
#include "layer_surface.h"
#include "map_memory.h"
#include "near_cells.h"
#include "scan_drift.h"
#include "scan_update.h"

static const double UNSURE = 0.13; /* of a layer: error of a growth that shows neither ink nor dead cells (by trial) */

/* Maps of one layer. What is only needed until an estimate is written stands in the maps of that estimate. */
typedef struct {
    double *scan;
    double *predicted; /* ... and other values between the registration and the end */
    PredictionVariance variance;
    DropletIncrements increments; /* squares, own: in the estimate */
    RegisteredScan registered;
    Room room;
    double *spare;       /* ROOM_MAPS maps: the registration's, and free before and after it */
    uint8_t *marks;      /* two maps, and one of the registration behind them */
    bool has_increments; /* those by what was known before stand in `increments` */
    void *memory;
} Workspace;

/* The increments that the registration takes stay for the ink. */
static Room room_in(const Workspace *work, double *strips, size_t threads, size_t cells) {
    return (Room){.threads = threads,
                  .weight = work->spare,
                  .rest = work->spare + cells,
                  .curvature = work->spare + 2 * cells,
                  .is_wall = work->marks + 2 * cells,
                  .strips = strips};
}

static bool workspace_open(Workspace *work, const EstimatorOptions *options, const JettedLayer *layer,
                           const SurfaceEstimate *after) {
    const Ink *unit = options->ink.model == INK_FULL ? NULL : options->ink.nominal;
    const size_t cells = options->nx * options->ny, adds = options->ink.inks * maps_of_ink(unit);
    const size_t threads = row_threads(layer->threads, options->nx, options->ny);
    const size_t strips = threads * STRIP_MAPS * STRIP * options->ny;
    double *maps = take_raw_maps(1, ((adds + ROOM_MAPS) * cells + strips) * sizeof(double) + 3 * cells);
    if (!maps)
        return false;
    *work = (Workspace){.memory = maps,
                        .scan = after->height,
                        .predicted = after->reckoned,
                        .increments = {unit, maps, after->variance, after->dead_evidence},
                        .spare = maps + adds * cells};
    double *strip = work->spare + ROOM_MAPS * cells;
    work->marks = (uint8_t *)(strip + strips);
    work->room = room_in(work, strip, threads, cells);
    return true;
}

static void workspace_close(Workspace *work) {
    close_room(&work->room);
    give_maps(work->memory);
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
    return !registers_scans(options) ||
           first_response(options->nx, options->ny, estimate->height, valid, estimate->response);
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

/* What the threads share that mark cells near others. */
typedef struct {
    size_t nx, ny;
    const uint8_t *cells;
    uint8_t *near;
} NearCells;

static INLINED void mark_near_rows(void *context, const RowRange *range) {
    const NearCells *work = context;
    for (size_t i = range->top; i < range->bottom; i++)
        mark_near_row(work->cells, work->nx, work->ny, i, work->near + i * work->ny);
}

CLONED_ROW_WORK(mark_near, mark_near_rows)

/* The scan without its drift, in `work`, with marks of the cells that droplets reach, and the variance of its readings.
 * False if there is no memory. */
static bool level_scan(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                       const double *measured, const uint8_t *valid, Workspace *work, const SurfaceEstimate *after,
                       double *noise) {
    const size_t nx = options->nx, ny = options->ny, cells = nx * ny;
    NearCells reached = {nx, ny, options->part, work->marks};
    const double *known = before->height;
    double *spare = work->spare;
    double *const scratch[DRIFT_MAPS] = {spare, spare + cells, spare + 2 * cells, after->variance,
                                         after->dead_evidence};
    if (is_displaced(&before->registration)) { /* walls reach further in such a scan */
        const Patch grid = {0, nx, 0, ny};
        const DisplacedView view = displaced_view(expected_displacement(&before->registration));
        const Ink both[2] = {before->ink[0], before->ink[options->ink.inks - 1]};
        if (!open_moved(&work->room, cells))
            return false;
        layer_surface(layer, before->height, both, work->spare, work->predicted);
        displaced_scan(nx, ny, work->predicted, &view, &grid, &(Scratch){work->room.moved.scratch, 0, nx},
                       (Rows){work->room.moved.surface, 0});
        known = work->room.moved.surface;
    }
    run_rows(layer->threads, nx, ny, mark_near, &reached);
    const ScanDrift drift = scan_drift(nx, ny, options->part, work->marks, measured, known, valid, scratch);
    take_drift_off(&drift, nx, ny, layer->threads, measured, valid, work->scan);
    *noise = reading_noise(options, before, drift.residual_variance);
    return true;
}

/* The scan in register; `noise`: variance of its readings. False if there is no memory. */
static bool take_scan(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                      bool is_unknown, const double *measured, const uint8_t *valid, Workspace *work,
                      SurfaceEstimate *after, double *noise) {
    const size_t cells = options->nx * options->ny;
    *noise = 0.0;
    for (size_t cell = 0; options->take_as_read && cell < cells; cell++)
        work->scan[cell] = valid[cell] ? measured[cell] : 0.0;
    if (!options->take_as_read && !level_scan(options, before, layer, measured, valid, work, after, noise))
        return false;
    const bool is_second = before->scans == 1 && options->noise_variance < 0.0; /* it shows what the first was worth */
    work->variance = (PredictionVariance){.before = before->variance,
                                          .unseen = is_second ? before->unseen : NULL,
                                          .first = *noise,
                                          .squares = work->increments.squares,
                                          .droplets = DROPLET_STD * DROPLET_STD,
                                          .noise = *noise};
    after->registration = before->registration;
    const ScanEvidence evidence = {.nx = options->nx,
                                   .ny = options->ny,
                                   .before = before->height,
                                   .predicted = work->predicted,
                                   .variance = work->variance,
                                   .response = before->response,
                                   .scan = work->scan,
                                   .valid = valid,
                                   .reached = work->marks,
                                   .noise_variance = *noise,
                                   .unsure = UNSURE * full_layer_height(&options->ink.nominal[0]),
                                   .is_first_layer = before->scans == 1,
                                   .is_unknown = is_unknown};
    if (!registers_scans(options)) {
        take_as_read(&evidence, &work->registered);
        return true;
    }
    droplet_increments(layer, before->height, options->ink.inks, before->ink, work->spare, &work->increments,
                       work->predicted);
    const bool is_done = register_scan(&evidence, &work->room, &after->registration, &work->registered);
    work->variance.misread = work->registered.misread;
    work->has_increments = work->registered.before == before->height;
    return is_done;
}

/* The ink after a scan; its increments are those of `widths`. */
static void take_ink(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                     const Workspace *work, SurfaceEstimate *after, Ink widths[INKS_MAX]) {
    const RegisteredScan *scan = &work->registered;
    Ink held[INKS_MAX] = {{0.0, 0.0, 0.0}};
    if (work->has_increments)
        memcpy(held, before->ink, sizeof held);
    const LearntLayer learnt = {.layer = layer,
                                .part = options->part,
                                .clear = scan->clear,
                                .before = scan->before,
                                .scan = scan->scan,
                                .variance = &work->variance,
                                .increments = work->increments,
                                .held = held,
                                .scratch = work->spare,
                                .values = work->predicted,
                                .marks = work->marks};
    learn_ink(&options->ink, &before->learnt, &learnt, &after->learnt, after->ink, widths);
}

/* is_unknown: the displacement of the scan is not learnt from, as the other things are not by the caller. */
static bool estimate_after(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                           bool is_unknown, const double *measured, const uint8_t *valid, SurfaceEstimate *after) {
    const size_t inks = options->ink.inks, cells = options->nx * options->ny;
    Workspace work;
    Ink widths[INKS_MAX];
    double noise;
    if (!workspace_open(&work, options, layer, after))
        return false;
    if (!take_scan(options, before, layer, is_unknown, measured, valid, &work, after, &noise)) {
        workspace_close(&work);
        return false;
    }
    take_ink(options, before, layer, &work, after, widths);
    const Ink both[2] = {after->ink[0], after->ink[inks - 1]};
    double *surface = work.spare + 2 * cells;
    layer_surface(layer, work.registered.before, both, work.spare, surface);
    layer_surface(layer, before->reckoned, both, work.spare, after->reckoned);
    ScanUpdate scan = {.options = options,
                       .before = before,
                       .layer = layer,
                       .registered = &work.registered,
                       .variance = &work.variance,
                       .increments = &work.increments,
                       .ink = widths,
                       .surface = surface,
                       .values = {work.spare, work.spare + cells, work.spare + 2 * cells},
                       .marks = work.marks,
                       .after = after,
                       .is_unknown = is_unknown};
    look_at_growth(&scan);
    if (correct_cells(&scan) > 0)
        forgive_dead(options, before, work.marks, after);
    after->noise_variance = noise;
    after->scans = before->scans + 1;
    look_at_cells(options, valid, layer->threads, after);
    workspace_close(&work);
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
    const JettedLayer nothing = {layer->nx,     layer->ny,    begun.unseen + cells, NULL,
                                 layer->passes, layer->order, layer->threads};
    const bool is_done = estimate_after(options, &begun, &nothing, true, measured, valid, after);
    memcpy(after->ink, before->ink, sizeof after->ink);
    memcpy(after->dead_evidence, before->dead_evidence, cells * sizeof(double));
    after->learnt = before->learnt;
    give_maps(memory);
    return is_done;
}
