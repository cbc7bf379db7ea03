#include "observer.h"

#include <math.h>
#include <string.h>

#include "layer_surface.h"
#include "map_memory.h"
#include "scan_fit.h"

static const double NOISE_KEPT = 0.7; /* share of the noise estimate kept from layer to layer (assumed) */
/* tilt of flat ground, in layers at a corner: a larger one is an error of levelling (assumed) */
static const double GROUND_TOLERANCE = 3.0;
static const double KNOWN_GROUND = 1e-18; /* variance of flat ground [m^2] */
static const double LEAST_SEEN = 0.02;    /* share of the grid: fewer readings are no scan */
static const double UNSURE = 1e-6;        /* variance of heights after a person has looked [m^2] */

static void take_datum_off(const EstimatorOptions *options, const ScanDatum *datum, const double *measured,
                           const uint8_t *valid, double *scan) {
    for (size_t i = 0; i < options->nx; i++) {
        double row[ROW_TERMS];
        datum_of_row(datum->term, place_on(i, options->nx), row);
        for (size_t j = 0; j < options->ny; j++) {
            const size_t cell = i * options->ny + j;
            scan[cell] = valid[cell] ? measured[cell] - datum_in_row(row, place_on(j, options->ny)) : 0.0;
        }
    }
}

static void keep_scan(const EstimatorOptions *options, const double *measured, const uint8_t *valid,
                      SurfaceEstimate *estimate) {
    for (size_t cell = 0; cell < options->nx * options->ny; cell++) {
        estimate->last[cell] = valid[cell] ? measured[cell] : 0.0;
        estimate->last_valid[cell] = valid[cell];
    }
}

/* The datum and the noise of the sensor from the first scan on ground that is flat. */
static void take_flat_ground(const EstimatorOptions *options, const double *measured, const uint8_t *valid,
                             SurfaceEstimate *estimate) {
    const size_t nx = options->nx, ny = options->ny;
    Knowledge *known = estimate->known;
    const ScanDatum datum = scan_datum(nx, ny, measured, valid, NULL, NULL, known->datum_spread, known->noise_variance);
    const double corner = fabs(datum.term[0]) + fabs(datum.term[1]) + fabs(datum.term[2]);
    if (options->noise_variance < 0.0)
        known->noise_variance = fmax(fmax(datum.noise_variance, options->steps_variance), NOISELESS);
    memcpy(known->neighbours, datum.neighbours, sizeof known->neighbours);
    memcpy(known->datum, datum.term, sizeof known->datum);
    known->trust.ground[0] = datum.term[0];
    known->trust.ground[1] = 2.0 * datum.term[1];
    known->trust.ground[2] = 2.0 * datum.term[2];
    known->trust.ground_wrong = corner > GROUND_TOLERANCE * layer_of(options);
    for (size_t cell = 0; cell < nx * ny; cell++) {
        estimate->height[cell] = 0.0;
        estimate->variance[cell] = KNOWN_GROUND;
    }
}

static bool is_scan(const EstimatorOptions *options, const uint8_t *valid) {
    const size_t cells = options->nx * options->ny;
    size_t seen = 0;
    for (size_t cell = 0; cell < cells; cell++)
        seen += valid[cell] != 0;
    return (double)seen >= LEAST_SEEN * (double)cells && seen > 0;
}

bool estimate_first(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                    SurfaceEstimate *estimate) {
    const size_t cells = options->nx * options->ny;
    if (!is_scan(options, valid))
        return false;
    *estimate->known = first_knowledge(options);
    const double noise = estimate->known->noise_variance;
    for (size_t cell = 0; cell < cells; cell++) {
        estimate->height[cell] = valid[cell] ? measured[cell] : 0.0;
        estimate->variance[cell] = valid[cell] ? noise : options->first_variance;
        estimate->unseen[cell] = valid[cell] ? 0 : 1;
        estimate->surprise[cell] = estimate->dead_evidence[cell] = 0.0;
        estimate->surprised[cell] = 0;
    }
    if (options->flat_ground && layer == 0 && !options->take_as_read)
        take_flat_ground(options, measured, valid, estimate);
    memcpy(estimate->ledger, estimate->height, cells * sizeof(double));
    keep_scan(options, measured, valid, estimate);
    look_at_part(options, valid, estimate);
    return true;
}

/* Updates a variance of readings by the one that a scan of ground shows. Ground that is not flat: the second scan is
 * compared with the first, so each has half of the variance. */
static double learnt(const EstimatorOptions *options, const Knowledge *known, double before, double shown) {
    if (known->scans > 1)
        return NOISE_KEPT * before + (1.0 - NOISE_KEPT) * shown;
    return options->flat_ground ? shown : 0.5 * shown;
}

/* Learns the noise of a reading from ground. */
static double reading_noise(const EstimatorOptions *options, const Knowledge *known, const ScanDatum *datum) {
    const double least = fmax(options->steps_variance, NOISELESS);
    if (options->noise_variance >= 0.0 || datum->noise_variance < 0.0)
        return fmax(known->noise_variance, least);
    return fmax(learnt(options, known, known->noise_variance, datum->noise_variance), least);
}

/* Adds to the ledger all droplets of nominal volume but those of dead nozzles; half of an unknown layer. */
static void count_droplets(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                           bool is_unknown, double *scratch, SurfaceEstimate *after) {
    const Ink both[2] = {options->ink.nominal[0], options->ink.nominal[options->ink.inks - 1]};
    layer_surface(layer, before->ledger, both, scratch, after->ledger);
    for (size_t cell = 0; is_unknown && cell < options->nx * options->ny; cell++)
        after->ledger[cell] = 0.5 * (before->ledger[cell] + after->ledger[cell]);
}

/* Sets the heights to the readings. */
static void take_as_read(const EstimatorOptions *options, const SurfaceEstimate *before, const double *predicted,
                         const double *measured, const uint8_t *valid, SurfaceEstimate *after) {
    const size_t cells = options->nx * options->ny;
    for (size_t cell = 0; cell < cells; cell++) {
        after->height[cell] = valid[cell] ? measured[cell] : predicted[cell];
        after->variance[cell] = valid[cell] ? 0.0 : before->variance[cell];
        after->unseen[cell] = valid[cell] ? 0 : before->unseen[cell] + 1;
        after->surprise[cell] = after->dead_evidence[cell] = 0.0;
        after->surprised[cell] = 0;
    }
}

/* Datum and noise of a scan: fills `datum`, and the map of the scan without its datum. Returns the noise [m^2]. */
static double take_ground(const EstimatorOptions *options, const SurfaceEstimate *before, const double *measured,
                          const uint8_t *valid, LayerMaps *maps, Knowledge *known, ScanDatum *datum) {
    const size_t nx = options->nx, ny = options->ny;
    mark_ground(nx, ny, options->part, maps->ground, maps->room.marks);
    *datum =
        scan_datum(nx, ny, measured, valid, before->height, maps->ground, known->datum_spread, known->noise_variance);
    if (datum->noise_variance < 0.0) /* no ground: the datum stays that of the last scan */
        memcpy(datum->term, known->datum, sizeof known->datum);
    take_datum_off(options, datum, measured, valid, maps->scan);
    const double noise =
        fmax(reading_noise(options, known, datum), rounding_variance(nx, ny, measured, valid, layer_of(options)));
    for (size_t cell = 0; known->scans == 1 && options->noise_variance < 0.0 && cell < nx * ny; cell++)
        if (before->unseen[cell] == 0 && !(maps->variance[cell] > noise) && before->variance[cell] != KNOWN_GROUND)
            maps->variance[cell] += noise; /* variance of the first scan */
    for (size_t axis = 0; axis < 2 && datum->noise_variance >= 0.0; axis++)
        known->neighbours[axis] = learnt(options, known, known->neighbours[axis], datum->neighbours[axis]);
    return noise;
}

/* Cells with a droplet of each ink, as a share of the part. */
static void count_printed(const EstimatorOptions *options, const int32_t *pattern, double printed[INKS_MAX]) {
    const size_t cells = options->nx * options->ny, part = count_marked(options->part, cells);
    for (size_t ink = 0; ink < INKS_MAX; ink++) {
        size_t count = 0;
        for (size_t cell = 0; cell < cells; cell++)
            count += pattern[cell] == (int32_t)ink + 1;
        printed[ink] = fmin((double)count / fmax((double)part, 1.0), 1.0);
    }
}

static bool look_at_scan(const EstimatorOptions *options, const SurfaceEstimate *before, int32_t number,
                         bool is_unknown, const double *measured, const uint8_t *valid, LayerMaps *maps,
                         SurfaceEstimate *after) {
    Knowledge *known = after->known;
    const bool is_first = known->scans == 1 && !options->flat_ground;
    ScanDatum datum;
    const double noise = take_ground(options, before, measured, valid, maps, known, &datum);
    ScanEvidence evidence = {.options = options,
                             .known = before->known,
                             .layer = &maps->living,
                             .scan = maps->scan,
                             .valid = valid,
                             .before = before->height,
                             .predicted = maps->predicted,
                             .variance = maps->variance,
                             .increments = &maps->increments,
                             .noise_variance = noise,
                             .droplet_variance = DROPLET_STD * DROPLET_STD * known->droplet_variance,
                             .datum = &datum};
    count_printed(options, maps->living.pattern, evidence.printed);
    slope_squares(options->nx, options->ny, maps->predicted, maps->slopes);
    evidence.noise_variance =
        take_lines_off(&evidence, known->neighbours, maps->slopes, maps->room.marks, &maps->room, maps->scan);
    const ScanDoubt doubt = {.evidence = &evidence,
                             .before = before,
                             .measured = after->last,
                             .noise_variance = is_first ? noise : known->noise_variance,
                             .layer = number,
                             .maps = maps};
    if (!is_scan(options, valid) || (!is_unknown && !known->trust.is_looked_at && doubt_scan(&doubt, &known->trust))) {
        live_on_prediction(
            &(MapUpdate){.evidence = &evidence, .before = before, .full_own = maps->full_own, .after = after});
        return true;
    }
    known->trust.is_looked_at = 0;
    known->noise_variance = is_unknown ? known->noise_variance : noise;
    return take_scan(&evidence, before, number, is_unknown, maps, after);
}

bool estimate_next(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   int32_t number, bool is_unknown, const double *measured, const uint8_t *valid,
                   SurfaceEstimate *after) {
    LayerMaps maps;
    if (!predict_layer(options, before, layer, is_unknown, &maps))
        return false;
    *after->known = *before->known;
    keep_scan(options, measured, valid, after);
    if (options->take_as_read)
        take_as_read(options, before, maps.predicted, measured, valid, after);
    const bool is_done =
        options->take_as_read || look_at_scan(options, before, number, is_unknown, measured, valid, &maps, after);
    if (is_done) {
        after->known->scans = before->known->scans + 1;
        count_droplets(options, before, &maps.living, is_unknown, maps.room.averaged, after);
        look_at_part(options, valid, after);
    }
    give_maps(maps.memory);
    return is_done;
}

void trust_again(SurfaceEstimate *estimate, size_t cells) {
    LoopTrust *trust = &estimate->known->trust;
    trust->is_volume_believed |= trust->stop == STOP_VOLUME;
    trust->stop = trust->stop_layer = trust->transform = 0;
    trust->stop_figure = trust->volume_doubt = 0.0;
    trust->is_looked_at = 1;
    for (int k = 0; k < DOUBTS; k++)
        trust->doubts[k] = 1.0; /* one more scan that fits another explanation stops the print */
    for (size_t cell = 0; cell < cells; cell++)
        estimate->variance[cell] = UNSURE;
}
