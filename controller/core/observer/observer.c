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

static void take_datum_off(void *context, const RowRange *range) {
    const ScanEvidence *evidence = context;
    const size_t nx = evidence->nx, ny = evidence->ny;
    for (size_t i = range->top; i < range->bottom; i++)
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            const double datum = datum_at(evidence->datum.term, place_on(i, nx), place_on(j, ny));
            evidence->scan[cell] = evidence->valid[cell] ? evidence->measured[cell] - datum : 0.0;
        }
}

static void keep_rows(void *context, const RowRange *range) {
    const ScanEvidence *evidence = context;
    size_t readings = 0;
    for (size_t cell = range->top * evidence->ny; cell < range->bottom * evidence->ny; cell++) {
        const uint8_t valid = evidence->valid[cell];
        evidence->after->last[cell] = valid ? evidence->measured[cell] : 0.0;
        evidence->after->last_valid[cell] = valid;
        readings += valid != 0;
    }
    evidence->sums[range->chunk].count[0] = readings;
}

/* Stores the scan in the estimate, and counts its readings. */
static void keep_scan(ScanEvidence *evidence) {
    evidence->readings = over_rows(evidence, keep_rows, evidence).count[0];
    evidence->measured = evidence->after->last;
    evidence->valid = evidence->after->last_valid;
}

/* Updates a variance by the one that a scan shows, each by its degrees of freedom. */
static double learnt(double before, double freedom, double shown, double freedom_shown) {
    return (freedom * before + freedom_shown * shown) / (freedom + freedom_shown);
}

/* Learns the noise of a reading from ground. */
static ReadingNoise learnt_noise(const ScanEvidence *evidence, const ReadingNoise *shown) {
    const EstimatorOptions *options = evidence->options;
    const Knowledge *known = evidence->known;
    /* ground that is not flat: the second scan is compared with the first, each has half of the variance */
    const double share = known->scans > 1 || options->flat_ground ? 1.0 : 0.5, kept = NOISE_KEPT * known->noise.freedom;
    ReadingNoise noise = known->noise;
    if (shown->variance >= 0.0) {
        for (size_t axis = 0; axis < 2; axis++)
            noise.neighbours[axis] =
                learnt(noise.neighbours[axis], kept, share * shown->neighbours[axis], shown->freedom);
        if (options->noise_variance < 0.0)
            noise.variance = learnt(noise.variance, kept, share * shown->variance, shown->freedom);
        noise.freedom = kept + shown->freedom;
    }
    noise.variance = fmax(noise.variance, fmax(options->steps_variance, NOISELESS));
    noise.variance = fmax(noise.variance, rounding_variance(evidence->nx, evidence->ny, evidence->measured,
                                                            evidence->valid, layer_of(options)));
    return noise;
}

/* The datum and the noise of the sensor from the first scan on ground that is flat. */
static void take_flat_ground(const ScanEvidence *evidence) {
    const EstimatorOptions *options = evidence->options;
    SurfaceEstimate *estimate = evidence->after;
    Knowledge *known = estimate->known;
    const ScanDatum datum =
        scan_datum(evidence, evidence->measured, evidence->valid, NULL, NULL, known->noise.variance);
    const double corner = fabs(datum.term[0]) + fabs(datum.term[1]) + fabs(datum.term[2]);
    known->noise = learnt_noise(evidence, &datum.noise);
    memcpy(known->datum, datum.term, sizeof known->datum);
    known->trust.ground[0] = datum.term[0];
    known->trust.ground[1] = 2.0 * datum.term[1];
    known->trust.ground[2] = 2.0 * datum.term[2];
    known->trust.ground_wrong = corner > GROUND_TOLERANCE * layer_of(options);
    for (size_t cell = 0; cell < evidence->cells; cell++) {
        estimate->height[cell] = 0.0;
        estimate->variance[cell] = KNOWN_GROUND;
    }
}

static bool is_scan(const ScanEvidence *evidence) {
    return (double)evidence->readings >= LEAST_SEEN * (double)evidence->cells;
}

bool estimate_first(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                    SurfaceEstimate *estimate) {
    const size_t cells = options->nx * options->ny;
    CellSums sums[CHUNKS];
    ScanEvidence evidence = {.options = options,
                             .nx = options->nx,
                             .ny = options->ny,
                             .cells = cells,
                             .after = estimate,
                             .known = estimate->known,
                             .living.threads = 1,
                             .measured = measured,
                             .valid = valid,
                             .sums = sums};
    keep_scan(&evidence);
    if (!is_scan(&evidence))
        return false;
    *estimate->known = first_knowledge(options);
    const double noise = estimate->known->noise.variance;
    for (size_t cell = 0; cell < cells; cell++) {
        estimate->height[cell] = valid[cell] ? measured[cell] : 0.0;
        estimate->variance[cell] = valid[cell] ? noise : options->first_variance;
        estimate->unseen[cell] = valid[cell] ? 0 : 1;
        estimate->surprise[cell] = estimate->dead_evidence[cell] = 0.0;
        estimate->surprised[cell] = 0;
    }
    if (options->flat_ground && layer == 0 && !options->take_as_read)
        take_flat_ground(&evidence);
    memcpy(estimate->ledger, estimate->height, cells * sizeof(double));
    look_at_part(&evidence);
    return true;
}

/* Adds to the ledger all droplets of nominal volume but those of dead nozzles; half of an unknown layer. */
static void count_droplets(const ScanEvidence *evidence) {
    const EstimatorOptions *options = evidence->options;
    const double *before = evidence->before->ledger;
    double *after = evidence->after->ledger;
    const Ink both[2] = {options->ink.nominal[0], options->ink.nominal[options->ink.inks - 1]};
    layer_surface(&evidence->living, before, both, evidence->averaged, after);
    for (size_t cell = 0; evidence->is_unknown && cell < evidence->cells; cell++)
        after[cell] = 0.5 * (before[cell] + after[cell]);
}

/* Sets the heights to the readings. */
static void take_as_read(const ScanEvidence *evidence) {
    const SurfaceEstimate *before = evidence->before, *after = evidence->after;
    for (size_t cell = 0; cell < evidence->cells; cell++) {
        const bool is_valid = evidence->valid[cell];
        after->height[cell] = is_valid ? evidence->measured[cell] : evidence->predicted[cell];
        after->variance[cell] = is_valid ? 0.0 : before->variance[cell];
        after->unseen[cell] = is_valid ? 0 : before->unseen[cell] + 1;
        after->surprise[cell] = after->dead_evidence[cell] = 0.0;
        after->surprised[cell] = 0;
    }
}

/* Datum and noise of a scan, and the scan without its datum. */
static ReadingNoise take_ground(ScanEvidence *evidence) {
    const SurfaceEstimate *before = evidence->before;
    const Knowledge *known = evidence->known;
    mark_ground(evidence);
    evidence->datum = scan_datum(evidence, evidence->measured, evidence->valid, before->height, evidence->ground,
                                 known->noise.variance);
    if (evidence->datum.noise.variance < 0.0) /* no ground: the datum stays that of the last scan */
        memcpy(evidence->datum.term, known->datum, sizeof known->datum);
    over_rows(evidence, take_datum_off, evidence);
    const ReadingNoise noise = learnt_noise(evidence, &evidence->datum.noise);
    for (size_t cell = 0; known->scans == 1 && evidence->options->noise_variance < 0.0 && cell < evidence->cells;
         cell++)
        if (before->unseen[cell] == 0 && !(evidence->variance[cell] > noise.variance) &&
            before->variance[cell] != KNOWN_GROUND)
            evidence->variance[cell] += noise.variance; /* variance of the first scan */
    return noise;
}

static bool look_at_scan(ScanEvidence *evidence) {
    const EstimatorOptions *options = evidence->options;
    Knowledge *known = evidence->after->known;
    LoopTrust *trust = &known->trust;
    const ReadingNoise noise = take_ground(evidence);
    evidence->usual_noise = known->scans == 1 && !options->flat_ground ? noise.variance : known->noise.variance;
    evidence->noise_variance = take_lines_off(evidence, &noise);
    if (!is_scan(evidence) || (!evidence->is_unknown && !trust->is_looked_at && doubt_scan(evidence, trust))) {
        live_on_prediction(evidence);
        return true;
    }
    trust->is_looked_at = 0;
    if (!evidence->is_unknown)
        known->noise = noise;
    return take_scan(evidence);
}

bool estimate_next(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   int32_t number, bool is_unknown, const double *measured, const uint8_t *valid,
                   SurfaceEstimate *after) {
    CellSums sums[CHUNKS];
    ScanEvidence evidence = {.options = options,
                             .nx = options->nx,
                             .ny = options->ny,
                             .cells = options->nx * options->ny,
                             .before = before,
                             .after = after,
                             .known = before->known,
                             .shares = options->ink.model == INK_OFF ? 0 : ink_shares(&options->ink),
                             .number = number,
                             .is_unknown = is_unknown,
                             .living = *layer,
                             .measured = measured,
                             .valid = valid,
                             .sums = sums,
                             .droplet_variance = DROPLET_STD * DROPLET_STD * before->known->droplet_variance};
    if (!predict_layer(&evidence))
        return false;
    *after->known = *before->known;
    keep_scan(&evidence);
    if (options->take_as_read)
        take_as_read(&evidence);
    const bool is_done = options->take_as_read || look_at_scan(&evidence);
    if (is_done) {
        after->known->scans = before->known->scans + 1;
        count_droplets(&evidence);
        look_at_part(&evidence);
    }
    give_maps(evidence.memory);
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
