#include "observer.h"

#include <math.h>
#include <string.h>

#include "layer_surface.h"
#include "map_memory.h"
#include "map_update.h"
#include "scan_datum.h"
#include "scan_doubts.h"
#include "scan_lines.h"

static const double SHARE_STD = 0.15, FULL_STD = 0.3; /* of a share of the ink before any scan (assumed) */
static const double DATUM_STD[DATUM_TERMS] = {1.3, 0.8, 0.8, 0.4, 0.4, 0.4}; /* layers (assumed) */
static const double DATUM_KEPT = 0.8, LEAST_SPREAD = 1e-17;                  /* [m^2] */
static const double NOISE_KEPT = 0.7, NOISELESS = 1e-20;                     /* [m^2] */
static const double LEVELLED = 0.5;
static const double LASTING = 2.0, FEW_LAST = 2e-4; /* times those that vanish; of the readings (assumed) */
static const double LINES_TELL = 0.5;       /* of the noise within a line: less that lines share is chance (assumed) */
static const double GROUND_TOLERANCE = 3.0; /* layers at a corner: more is no levelling (assumed) */
static const double KNOWN_GROUND = 1e-18;   /* [m^2], variance of flat ground */
static const double LEAST_SEEN = 0.02;      /* of the grid: fewer readings are no scan */
static const double FOREIGN_MISFIT = 4.0;   /* two standard deviations: no droplet of the model's (assumed) */
static const double USUAL_MISFIT = 2.0;     /* up to which droplets explain it */
static const double KEPT = 0.8;             /* of what was learnt, from layer to layer */
static const double LEAST_VARIATION = 0.01, LARGEST_FOUND = 9.0, LARGEST_VARIATION = 2.0; /* in DROPLET_STD^2 */
static const double FIRST_EVIDENCE = 10.0, EVIDENCE_MAX = 500.0;                          /* degrees of freedom */
static const double OF_A_MEDIAN = 0.37; /* degrees of freedom of a cell in the median of squares */
static const double UNSURE = 1e-6;      /* [m^2], variance of heights that a person has looked at */
static const double NO_VOLUME = 1e-12;  /* of a droplet of a dead nozzle */
enum { EARLY = 12, LEAST_DROPLETS = 20 };

/* Maps of one layer. */
typedef struct {
    double *scan, *predicted, *slopes, *squares, *own, *full_own, *factor, *spare[4], *adds;
    uint8_t *ground, *walls, *marks; /* `marks`: two maps */
    void *memory;
} Workspace;

static bool workspace_open(Workspace *work, const EstimatorOptions *options) {
    const size_t cells = options->nx * options->ny;
    const size_t adds = options->ink.inks * (options->ink.model == INK_FULL ? ORDERS : 1);
    double *maps = take_raw_maps(cells, (11 + adds) * sizeof(double) + 4);
    if (!maps)
        return false;
    *work = (Workspace){.memory = maps,
                        .scan = maps,
                        .predicted = maps + cells,
                        .slopes = maps + 2 * cells,
                        .squares = maps + 3 * cells,
                        .own = maps + 4 * cells,
                        .full_own = maps + 5 * cells,
                        .factor = maps + 6 * cells,
                        .spare = {maps + 7 * cells, maps + 8 * cells, maps + 9 * cells, maps + 10 * cells},
                        .adds = maps + 11 * cells};
    work->ground = (uint8_t *)(maps + (11 + adds) * cells);
    work->walls = work->ground + cells;
    work->marks = work->walls + cells;
    return true;
}

static void take_datum_off(const EstimatorOptions *options, const ScanDatum *datum, const double *measured,
                           const uint8_t *valid, double *scan) {
    for (size_t i = 0; i < options->nx; i++) {
        double row[ROW_TERMS];
        datum_of_row(datum->term, place_on(i, options->nx), row);
        for (size_t j = 0; j < options->ny; j++) {
            const size_t cell = i * options->ny + j;
            const double w = place_on(j, options->ny);
            scan[cell] = valid[cell] ? measured[cell] - (row[0] + w * (row[1] + w * row[2])) : 0.0;
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

static Knowledge begin(const EstimatorOptions *options) {
    const size_t n = ink_shares(&options->ink);
    const double deviation = options->ink.model == INK_FULL ? FULL_STD : SHARE_STD, layer = layer_of(options);
    Knowledge known = {.registration = no_registration(options->nx, options->ny),
                       .trust = full_trust(),
                       .noise_variance = fmax(options->noise_variance, options->steps_variance),
                       .droplet_variance = 1.0,
                       .droplet_evidence = FIRST_EVIDENCE,
                       .scans = 1};
    for (size_t k = 0; k < n; k++) {
        known.share[k] = 1.0;
        known.share_covariance[k * n + k] = options->ink.model == INK_OFF ? 0.0 : deviation * deviation;
    }
    for (size_t k = 0; k < DATUM_TERMS; k++)
        known.datum_spread[k] = DATUM_STD[k] * DATUM_STD[k] * layer * layer;
    return known;
}

/* On ground that is called flat the first scan shows the datum and the noise of the sensor. */
static void take_flat_ground(const EstimatorOptions *options, const double *measured, const uint8_t *valid,
                             SurfaceEstimate *estimate) {
    const size_t cells = options->nx * options->ny;
    Knowledge *known = estimate->known;
    const double layer = layer_of(options), *spread = known->datum_spread;
    const ScanDatum datum = scan_datum(options->nx, options->ny, measured, valid, NULL, NULL, spread,
                                       fmax(known->noise_variance, NOISELESS));
    const double corner = fabs(datum.term[0]) + fabs(datum.term[1]) + fabs(datum.term[2]);
    if (options->noise_variance < 0.0)
        known->noise_variance = fmax(fmax(datum.noise_variance, options->steps_variance), NOISELESS);
    memcpy(known->neighbours, datum.neighbours, sizeof known->neighbours);
    memcpy(known->datum, datum.term, sizeof known->datum);
    known->trust.ground[0] = datum.term[0];
    known->trust.ground[1] = 2.0 * datum.term[1];
    known->trust.ground[2] = 2.0 * datum.term[2];
    known->trust.ground_wrong = corner > GROUND_TOLERANCE * layer;
    for (size_t cell = 0; cell < cells; cell++) {
        estimate->height[cell] = 0.0;
        estimate->variance[cell] = KNOWN_GROUND;
    }
}

bool estimate_first(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                    SurfaceEstimate *estimate) {
    const size_t cells = options->nx * options->ny;
    *estimate->known = begin(options);
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

/* The layer without droplets from dead nozzles, and what all of them would leave on their cells. */
static JettedLayer living_droplets(const EstimatorOptions *options, const SurfaceEstimate *before,
                                   const JettedLayer *layer, const Ink ink[], Workspace *work) {
    JettedLayer living = *layer;
    bool has_dead = false;
    for (size_t cell = 0; cell < options->nx * options->ny; cell++) {
        const int32_t kind = layer->pattern[cell];
        const double volume = layer->factor ? layer->factor[cell] : 1.0;
        const bool is_dead = before->dead_evidence[cell] >= DEAD_EVIDENCE;
        work->full_own[cell] = kind > 0 ? volume * ink[kind - 1].h1 : 0.0;
        work->factor[cell] = is_dead ? NO_VOLUME : volume;
        has_dead |= is_dead && kind > 0;
    }
    if (has_dead)
        living.factor = work->factor;
    return living;
}

/* Share of the variance of a height that a layer leaves: where a cell is higher than its neighbours, more of their
 * droplets stays with them. Errors that neighbours share stay: of those of single cells half is levelled (assumed). */
static double levelled(const EstimatorOptions *options, const JettedLayer *layer, const Ink *ink) {
    size_t droplets = 0, part = 0;
    for (size_t cell = 0; cell < options->nx * options->ny; cell++) {
        droplets += layer->pattern[cell] > 0;
        part += options->part[cell] != 0;
    }
    const double runs = 4.0 * ink->h2 / (ink->h1 + ink->h2) + 4.0 * ink->h3 / (ink->h1 + ink->h3);
    return 1.0 - LEVELLED * fmin(runs, 1.0) * (double)droplets / fmax((double)part, 1.0);
}

/* The prediction; of an unknown layer the middle of nothing and all, with the variance of a uniform distribution, and
 * without droplets. */
static void predict(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                    bool is_unknown, Workspace *work, DropletIncrements *increments, double *variance) {
    const size_t cells = options->nx * options->ny;
    const Ink *unit = options->ink.model == INK_FULL ? NULL : options->ink.nominal;
    Ink ink[INKS_MAX];
    learnt_inks(options, before->known, ink);
    *increments = (DropletIncrements){unit, work->adds, work->squares, work->own};
    droplet_increments(layer, before->height, options->ink.inks, ink, work->spare[0], increments, work->predicted);
    const double left = levelled(options, layer, ink);
    for (size_t cell = 0; cell < cells; cell++)
        variance[cell] = before->variance[cell] * (work->squares[cell] > 0.0 ? left : 1.0);
    if (!is_unknown)
        return;
    for (size_t cell = 0; cell < cells; cell++) {
        const double whole = work->predicted[cell] - before->height[cell];
        work->predicted[cell] = before->height[cell] + 0.5 * whole;
        variance[cell] += whole * whole / 12.0;
        work->squares[cell] = work->own[cell] = 0.0;
    }
    memset(work->adds, 0, options->ink.inks * maps_of_ink(unit) * cells * sizeof(double));
}

/* A variance of readings with what a scan of ground shows: of the second scan of ground that is not flat half of it is
 * the first's. */
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

/* Takes the offsets of lines off the scan, if they tell; returns the noise that is left to a reading. seen: the
 * geometry of the scans so far. */
static double level_lines(const EstimatorOptions *options, const Knowledge *known, const double seen[GEOMETRY],
                          double noise, const uint8_t *valid, const double *variance, Workspace *work) {
    const size_t nx = options->nx, ny = options->ny;
    const Registration *registration = &known->registration;
    const double excess = known->neighbours[0] - known->neighbours[1];
    const double least = fmax(options->steps_variance, NOISELESS);
    const double within = fmax(fmin(known->neighbours[0], known->neighbours[1]), least);
    double shift = fmax(registration->covariance[0], registration->covariance[GEOMETRY + 1]);
    if (!(fabs(excess) > LINES_TELL * within))
        return noise;
    LineSearch search = {.nx = nx,
                         .ny = ny,
                         .expected = work->predicted,
                         .variance = variance,
                         .slopes = work->slopes,
                         .valid = valid,
                         .near = work->marks,
                         .noise = within,
                         .excess = excess};
    if (registration->is_displaced) {
        means_over_spot(nx, ny, work->predicted, seen[SPREAD], work->spare[1], work->spare[2]);
        read_displaced(nx, ny, work->spare[2], seen, work->spare[0]);
        search.expected = work->spare[0];
    } else
        shift += fmax(seen[SHIFT_X] * seen[SHIFT_X], seen[SHIFT_Y] * seen[SHIFT_Y]);
    search.shift_variance = options->register_scans ? shift : 0.0;
    return within + take_lines_off(&search, work->scan, work->spare[1]);
}

/* Variation of the droplets, by the residuals of the growth of cells. */
static void learn_droplets(const InkFit *fit, Knowledge *known) {
    LoopTrust *trust = &known->trust;
    const double unit = DROPLET_STD * DROPLET_STD, own = unit * fit->mean_droplets, variation = known->droplet_variance;
    if (fit->droplets < LEAST_DROPLETS || !(own > 0.0))
        return;
    const double surplus = (fit->misfit[OWN] - 1.0) * (fit->mean_base + variation * own) / own;
    const double found = fmax(LEAST_VARIATION, variation + surplus);
    const double share = variation * own / (fit->mean_base + variation * own);
    const double freedom = OF_A_MEDIAN * (double)fit->droplets * share * share;
    const double kept = KEPT * known->droplet_evidence, prior = (1.0 - KEPT) * FIRST_EVIDENCE;
    const double evidence = kept + prior + freedom; /* what is forgotten is the prior again: droplets vary */
    const double mean = (kept * variation + prior + freedom * fmin(found, LARGEST_FOUND)) / evidence;
    known->droplet_variance = fmin(mean, LARGEST_VARIATION);
    known->droplet_evidence = fmin(evidence, EVIDENCE_MAX);
    trust->layers++;
    trust->surprise = KEPT * trust->surprise + (1.0 - KEPT) * fit->misfit[OWN];
    trust->spill = KEPT * trust->spill + (1.0 - KEPT) * fit->misfit[SPILL];
    if (trust->layers <= EARLY)
        trust->early += (found - trust->early) / (double)trust->layers;
}

static void learn_datum(const ScanDatum *datum, const InkFit *fit, Knowledge *known) {
    if (datum->noise_variance < 0.0)
        return;
    memcpy(known->datum, datum->term, sizeof known->datum);
    for (size_t k = 0; k < DATUM_TERMS; k++) {
        known->datum[k] += fit->datum[k];
        known->datum_spread[k] = DATUM_KEPT * known->datum_spread[k] +
                                 (1.0 - DATUM_KEPT) * fmax(known->datum[k] * known->datum[k], LEAST_SPREAD);
    }
}

/* Whether droplets are of another kind: scans have left as much for some time, or do so again. A few spikes on few
 * cells are none, and a layer of few droplets shows nothing. */
static bool are_droplets_foreign(const LoopTrust *trust, const InkFit *fit) {
    const double own = KEPT * trust->surprise + (1.0 - KEPT) * fit->misfit[OWN];
    const double spill = KEPT * trust->spill + (1.0 - KEPT) * fit->misfit[SPILL];
    const double lasting = fmax(own, spill);
    return lasting >= FOREIGN_MISFIT || (is_misfit(fit) && lasting > USUAL_MISFIT);
}

/* Whether surprises have been the cells' and not the sensor's: then they are believed at once. */
static bool do_surprises_last(const Knowledge *known) {
    return known->lasting > LASTING * known->vanishing + FEW_LAST;
}

/* A scan and all that is made of it on the way. */
typedef struct {
    ScanEvidence evidence;
    ScanDatum datum;
    FitRoom room;
    InkFit in_register, displaced;
    bool is_unknown;
} Look;

/* Fits the scan, chooses between in register and displaced, and updates the maps. */
static bool take_scan(const EstimatorOptions *options, const SurfaceEstimate *before, Look *look, int32_t number,
                      Workspace *work, SurfaceEstimate *after) {
    const ScanEvidence *evidence = &look->evidence;
    Knowledge *known = after->known;
    Registration *registration = &known->registration;
    const bool is_registered = options->register_scans && !look->is_unknown;
    if (!fit_in_register(evidence, &look->room, &look->in_register))
        return false;
    if (is_registered &&
        !fit_displaced(evidence, work->slopes, &look->in_register, &look->room, registration, &look->displaced))
        return false;
    const bool is_displaced = registration->is_displaced;
    const bool may_be = is_registered && registration->fits > 0 && may_be_displaced(registration);
    const InkFit *fit = is_displaced && is_registered ? &look->displaced : &look->in_register;
    const bool is_foreign = !may_be && are_droplets_foreign(&known->trust, fit);
    const double odds = 1.0 / (1.0 + exp(-registration->odds)); /* probability that scans are displaced */
    double doubtful[GEOMETRY * GEOMETRY];
    memcpy(doubtful, registration->covariance, sizeof doubtful);
    for (size_t a = 0; a < GEOMETRY && !is_displaced; a++)
        for (size_t b = 0; b < GEOMETRY; b++)
            doubtful[a * GEOMETRY + b] =
                odds * (doubtful[a * GEOMETRY + b] + registration->estimate[a] * registration->estimate[b]);
    MapUpdate update = {.evidence = evidence,
                        .before = before,
                        .fit = fit,
                        .geometry = is_displaced || may_be ? doubtful : NULL,
                        .walls = work->walls,
                        .spread_slope = look->room.spread_slope,
                        .full_own = work->full_own,
                        .is_robust = !is_foreign && !do_surprises_last(known),
                        .is_telling = !look->is_unknown,
                        .scratch = {work->slopes, work->spare[2], work->spare[3]},
                        .after = after};
    for (size_t class = 0; class < CLASSES && !may_be && !is_displaced; class++)
        update.extra[class] = fmax(fit->misfit[class] - USUAL_MISFIT, 0.0);
    double g[GEOMETRY];
    geometry_seen(registration, g);
    if (is_displaced) {
        double *expected = work->spare[3];
        for (size_t cell = 0; cell < options->nx * options->ny; cell++)
            expected[cell] = evidence->predicted[cell] + share_change(evidence, fit->share, cell);
        means_over_spot(options->nx, options->ny, expected, g[SPREAD], work->spare[2], look->room.averaged);
        slope_with_spot(options->nx, options->ny, expected, look->room.averaged, g[SPREAD], work->spare[2],
                        look->room.spread_slope);
    }
    const Surprises found =
        is_displaced ? update_displaced(&update, g, look->room.averaged) : update_in_register(&update);
    if (look->is_unknown)
        return true;
    const double seen = fmax((double)found.seen, 1.0);
    known->vanishing = 0.9 * known->vanishing + 0.1 * (double)found.vanished / seen;
    known->lasting = 0.9 * known->lasting + 0.1 * (double)found.lasted / seen;
    const bool is_better = may_be && is_misfit(&look->in_register);
    learn_droplets(is_displaced || is_better ? &look->displaced : &look->in_register, known);
    learn_datum(&look->datum, fit, known);
    memcpy(known->share, fit->share, sizeof known->share);
    memcpy(known->share_covariance, fit->covariance, sizeof known->share_covariance);
    if (!is_misfit(fit) && !known->trust.is_volume_believed)
        doubt_volume(options, known, number, &known->trust);
    return true;
}

/* The ledger grows by all droplets but those of dead nozzles, of nominal volume; of an unknown layer by half. */
static void count_droplets(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                           bool is_unknown, double *scratch, SurfaceEstimate *after) {
    const Ink both[2] = {options->ink.nominal[0], options->ink.nominal[options->ink.inks - 1]};
    layer_surface(layer, before->ledger, both, scratch, after->ledger);
    for (size_t cell = 0; is_unknown && cell < options->nx * options->ny; cell++)
        after->ledger[cell] = 0.5 * (before->ledger[cell] + after->ledger[cell]);
}

static bool is_scan(const EstimatorOptions *options, const uint8_t *valid) {
    const size_t cells = options->nx * options->ny;
    size_t seen = 0;
    for (size_t cell = 0; cell < cells; cell++)
        seen += valid[cell] != 0;
    return (double)seen >= LEAST_SEEN * (double)cells && seen > 0;
}

/* Heights as they were read. */
static void take_as_read(const EstimatorOptions *options, const SurfaceEstimate *before, const Workspace *work,
                         const double *measured, const uint8_t *valid, SurfaceEstimate *after) {
    const size_t cells = options->nx * options->ny;
    for (size_t cell = 0; cell < cells; cell++) {
        after->height[cell] = valid[cell] ? measured[cell] : work->predicted[cell];
        after->variance[cell] = valid[cell] ? 0.0 : before->variance[cell];
        after->unseen[cell] = valid[cell] ? 0 : before->unseen[cell] + 1;
        after->surprise[cell] = after->dead_evidence[cell] = 0.0;
        after->surprised[cell] = 0;
    }
}

/* Heights and their variance without a scan that counts. */
static void live_on(const Look *look, const SurfaceEstimate *before, const Workspace *work, SurfaceEstimate *after) {
    InkFit known = {.droplets = 0};
    memcpy(known.share, before->known->share, sizeof known.share);
    live_on_prediction(&(MapUpdate){
        .evidence = &look->evidence, .before = before, .fit = &known, .full_own = work->full_own, .after = after});
}

static bool look_at_scan(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                         int32_t number, bool is_unknown, const double *measured, const uint8_t *valid, Workspace *work,
                         double *variance, SurfaceEstimate *after) {
    const size_t nx = options->nx, ny = options->ny, cells = nx * ny;
    DropletIncrements increments;
    predict(options, before, layer, is_unknown, work, &increments, variance);
    if (options->take_as_read) {
        take_as_read(options, before, work, measured, valid, after);
        return true;
    }
    Knowledge *known = after->known;
    Look look = {.is_unknown = is_unknown};
    const double *spread = known->datum_spread;
    mark_ground(nx, ny, options->part, work->ground, work->marks);
    look.datum = scan_datum(nx, ny, measured, valid, before->height, work->ground, spread,
                            fmax(known->noise_variance, NOISELESS));
    if (look.datum.noise_variance < 0.0) /* no ground: a profiler that keeps its frame */
        memcpy(look.datum.term, known->datum, sizeof known->datum);
    take_datum_off(options, &look.datum, measured, valid, work->scan);
    const double noise =
        fmax(reading_noise(options, known, &look.datum), rounding_variance(nx, ny, measured, valid, layer_of(options)));
    for (size_t cell = 0; known->scans == 1 && options->noise_variance < 0.0 && cell < cells; cell++)
        if (before->unseen[cell] == 0 && !(variance[cell] > noise) && before->variance[cell] != KNOWN_GROUND)
            variance[cell] += noise; /* what the first scan was worth */
    for (size_t axis = 0; axis < 2 && look.datum.noise_variance >= 0.0; axis++)
        known->neighbours[axis] = learnt(options, known, known->neighbours[axis], look.datum.neighbours[axis]);
    slope_squares(nx, ny, work->predicted, work->slopes);
    double seen[GEOMETRY];
    geometry_seen(&known->registration, seen);
    const double within = level_lines(options, known, seen, noise, valid, variance, work);
    look.evidence = (ScanEvidence){.options = options,
                                   .known = before->known,
                                   .layer = layer,
                                   .scan = work->scan,
                                   .valid = valid,
                                   .before = before->height,
                                   .predicted = work->predicted,
                                   .variance = variance,
                                   .increments = &increments,
                                   .noise_variance = within,
                                   .droplet_variance = DROPLET_STD * DROPLET_STD * known->droplet_variance,
                                   .datum = &look.datum};
    look.room = (FitRoom){work->spare[0], work->spare[1], {work->spare[2], work->spare[3]}, work->walls, work->marks};
    if (!is_scan(options, valid)) {
        live_on(&look, before, work, after);
        return true;
    }
    ScanDoubt doubt = {.evidence = &look.evidence,
                       .before = before,
                       .measured = after->last,
                       .ground = work->ground,
                       .slopes = work->slopes,
                       .geometry = known->registration.is_displaced ? seen : NULL,
                       .noise_variance = known->scans == 1 && !options->flat_ground ? noise : known->noise_variance,
                       .layer = number,
                       .expected = work->spare[0],
                       .past = work->spare[1],
                       .other = work->spare[2],
                       .lines = work->spare[3],
                       .even = work->walls,
                       .marks = work->marks};
    if (!is_unknown && !known->trust.is_looked_at && doubt_scan(&doubt, &known->trust)) {
        live_on(&look, before, work, after);
        return true;
    }
    known->trust.is_looked_at = 0;
    known->noise_variance = is_unknown ? known->noise_variance : noise;
    return take_scan(options, before, &look, number, work, after);
}

bool estimate_next(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   int32_t number, bool is_unknown, const double *measured, const uint8_t *valid,
                   SurfaceEstimate *after) {
    Workspace work;
    Ink ink[INKS_MAX];
    double *variance = take_raw_maps(options->nx * options->ny, sizeof(double));
    if (!variance || !workspace_open(&work, options)) {
        give_maps(variance);
        return false;
    }
    *after->known = *before->known;
    keep_scan(options, measured, valid, after);
    learnt_inks(options, before->known, ink);
    const JettedLayer living = living_droplets(options, before, layer, ink, &work);
    const bool is_done =
        look_at_scan(options, before, &living, number, is_unknown, measured, valid, &work, variance, after);
    if (is_done) {
        after->known->scans = before->known->scans + 1;
        count_droplets(options, before, &living, is_unknown, work.spare[0], after);
        look_at_part(options, valid, after);
    }
    give_maps(work.memory);
    give_maps(variance);
    return is_done;
}

void trust_again(SurfaceEstimate *estimate, size_t cells) {
    LoopTrust *trust = &estimate->known->trust;
    trust->is_volume_believed |= trust->stop == STOP_VOLUME;
    trust->stop = trust->stop_layer = trust->transform = 0;
    trust->stop_figure = trust->volume_doubt = 0.0;
    trust->is_looked_at = 1;
    for (int k = 0; k < DOUBTS; k++)
        trust->doubts[k] = 1.0; /* one more scan that fits another explanation is enough */
    for (size_t cell = 0; cell < cells; cell++)
        estimate->variance[cell] = UNSURE;
}
