#include "scan_update.h"

#include <math.h>
#include <string.h>

#include "dead_cells.h"
#include "near_cells.h"

static const double SURPRISE = 5.0; /* standard deviations off the prediction from which on the model of a cell is
                                       wrong, not the scan (by trial) */
static const double HALF = 0.5;     /* of the part */

static void on_all_rows(RowWork *work, ScanUpdate *scan) {
    run_rows(scan->layer->threads, scan->layer->nx, scan->layer->ny, work, scan);
}

static ChunkSums sum_of_chunks(const ScanUpdate *scan) {
    ChunkSums all = {0};
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        const ChunkSums *one = &scan->sums[chunk];
        all.part_cells += one->part_cells;
        all.dry += one->dry;
        all.trials += one->trials;
        all.revived += one->revived;
        all.droplets += one->droplets;
        all.spills += one->spills;
        all.built += one->built;
        all.wanted += one->wanted;
        all.variance += one->variance;
    }
    return all;
}

/* Whether the growth tells of droplets. */
static bool is_telling(const ScanUpdate *scan) {
    return !scan->is_unknown && !scan->options->take_as_read;
}

/* Some cells: what was read, known and predicted of them. */
typedef struct {
    double scan[CARRIED], known[CARRIED], predicted[CARRIED];
    double spread[CARRIED], error[CARRIED]; /* variances of the predictions and of the readings [m^2] */
    double grown[CARRIED];                  /* by what the droplets of other cells do not explain [m] */
} Cells;

/* `own`: what their droplets were to leave on them. */
static INLINED void take_cells(const ScanUpdate *scan, size_t first, size_t count, const double *own, Cells *cells) {
    const size_t all = scan->options->nx * scan->options->ny, inks = scan->options->ink.inks;
    const double *misread = scan->registered->misread, noise = scan->variance->noise;
    double added[CARRIED];
    memcpy(cells->scan, scan->registered->scan + first, count * sizeof(double));
    memcpy(cells->known, scan->registered->before + first, count * sizeof(double));
    predicted_variance(scan->variance, first, count, cells->spread);
    for (size_t k = 0; k < count; k++)
        cells->error[k] = noise + (misread ? misread[first + k] : 0.0);
    added_heights(scan->increments, all, first, count, inks, scan->ink, added);
    for (size_t k = 0; k < count; k++)
        cells->grown[k] = cells->scan[k] - cells->known[k] - added[k] + own[k];
    memcpy(cells->predicted, scan->surface + first, count * sizeof(double));
}

/* Marks the trials of dead cells. */
static INLINED void mark_trial_rows(void *context, const RowRange *range) {
    ScanUpdate *scan = context;
    const size_t ny = scan->options->ny;
    const int32_t *pattern = scan->layer->pattern;
    const double *dead = scan->before->dead_evidence;
    uint8_t *restrict trial = scan->marks + scan->options->nx * ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t begin = chunk_row(scan->options->nx, chunk) * ny;
        const size_t end = chunk_row(scan->options->nx, chunk + 1) * ny;
        for (size_t cell = begin; cell < end; cell++)
            trial[cell] = (pattern[cell] > 0) & (dead[cell] >= DEAD_EVIDENCE);
        scan->sums[chunk] = (ChunkSums){.trials = count_marked(trial + begin, end - begin)};
    }
}

CLONED_ROW_WORK(mark_trials, mark_trial_rows)

/* Marks the cells of a row of the part whose growth tells of droplets: measured, and not near a trial of a dead cell,
 * from which nothing is expected. */
static INLINED void mark_telling_row(const ScanUpdate *scan, size_t i) {
    const size_t nx = scan->options->nx, ny = scan->options->ny;
    const uint8_t *part = scan->options->part + i * ny, *clear = scan->registered->clear + i * ny;
    uint8_t *restrict telling = scan->marks + i * ny;
    if (scan->has_trials)
        mark_near_row(scan->marks + nx * ny, nx, ny, i, telling);
    else
        memset(telling, 0, ny);
    for (size_t j = 0; j < ny; j++)
        telling[j] = (part[j] != 0) & (clear[j] != 0) & (telling[j] == 0);
}

/* Whether cells are reached by droplets that they were to show: 1 or 0. */
static INLINED void mark_reached(const ScanUpdate *scan, size_t first, size_t count, const Cells *cells,
                                 uint8_t *restrict reached) {
    const uint8_t *telling = scan->marks + first;
    const double *predicted = cells->predicted, *known = cells->known, *spread = cells->spread, *error = cells->error;
    for (size_t k = 0; k < count; k++)
        reached[k] = (telling[k] != 0) & (predicted[k] > known[k]) & (spread[k] + error[k] > 0.0);
}

/* Appends the values of the cells that are chosen; returns the end. No branch depends on a cell. */
static INLINED double *append(const double *values, const uint8_t *chosen, size_t count, double *end) {
    for (size_t k = 0; k < count; k++) {
        *end = values[k];
        end += chosen[k];
    }
    return end;
}

/* What cells with a droplet grew by as a share of what was expected. */
static INLINED double *append_shares(const ScanUpdate *scan, size_t first, size_t count, const Cells *cells,
                                     double *end) {
    const int32_t *pattern = scan->layer->pattern + first;
    uint8_t reached[CARRIED];
    double share[CARRIED];
    mark_reached(scan, first, count, cells, reached);
    for (size_t k = 0; k < count; k++)
        share[k] = (cells->scan[k] - cells->known[k]) / (cells->predicted[k] - cells->known[k]);
    for (size_t k = 0; k < count; k++)
        reached[k] &= pattern[k] > 0;
    return append(share, reached, count, end);
}

/* Heights of the part among some cells. */
static INLINED void add_part(const ScanUpdate *scan, size_t first, size_t count, const Cells *cells, ChunkSums *sums) {
    const uint8_t *part = scan->options->part + first;
    const double *target = scan->options->target + first;
    double built[CARRIED], wanted[CARRIED];
    uint8_t is_part[CARRIED];
    for (size_t k = 0; k < count; k++) {
        built[k] = part[k] ? cells->known[k] : 0.0;
        wanted[k] = part[k] ? target[k] : 0.0;
    }
    for (size_t k = 0; k < count; k++)
        is_part[k] = part[k] != 0;
    sums->part_cells += count_marked(is_part, count);
    sums->built += lane_sum(built, count);
    sums->wanted += lane_sum(wanted, count);
}

/* Counts dry cells and takes shares; leaves what droplets were to leave on cells where it is sure what they grew by. */
static INLINED void look_at_rows(void *context, const RowRange *range) {
    ScanUpdate *scan = context;
    const size_t nx = scan->options->nx, ny = scan->options->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t top = chunk_row(nx, chunk), bottom = chunk_row(nx, chunk + 1), end = bottom * ny;
        double *shares = scan->values[DROPLETS] + top * ny, *last = shares;
        ChunkSums *sums = &scan->sums[chunk];
        Cells cells;
        for (size_t i = top; i < bottom; i++)
            mark_telling_row(scan, i);
        for (size_t first = top * ny; first < end; first += CARRIED) {
            const size_t count = end - first < CARRIED ? end - first : CARRIED;
            const uint8_t *clear = scan->registered->clear + first;
            double *restrict own = scan->increments->own + first;
            take_cells(scan, first, count, own, &cells);
            for (size_t k = 0; k < count; k++) {
                const double left = own[k];
                own[k] = clear[k] ? left : 0.0;
            }
            sums->dry += count_dry(count, own, cells.grown);
            add_part(scan, first, count, &cells, sums);
            last = append_shares(scan, first, count, &cells, last);
        }
        sums->droplets = (size_t)(last - shares);
    }
}

CLONED_ROW_WORK(look_at_range, look_at_rows)

void look_at_growth(ScanUpdate *scan) {
    const EstimatorOptions *options = scan->options;
    ValueLists shares = {.nx = options->nx, .ny = options->ny, .map = scan->values[DROPLETS]};
    double learnt = 0.0, nominal = 0.0;
    on_all_rows(mark_trials, scan);
    scan->has_trials = sum_of_chunks(scan).trials > 0;
    on_all_rows(look_at_range, scan);
    const ChunkSums all = sum_of_chunks(scan);
    scan->is_dry = is_head_dry(all.dry, all.part_cells);
    scan->after->trust = scan->before->trust;
    scan->after->trust.volume = scan->volume = 1.0;
    if (!is_telling(scan))
        return;
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        shares.lengths[chunk] = scan->sums[chunk].droplets;
    for (size_t k = 0; k < options->ink.inks; k++) {
        learnt += full_layer_height(&scan->after->ink[k]);
        nominal += full_layer_height(&options->ink.nominal[k]);
    }
    scan->volume = learn_volume(&shares, all.droplets, all.part_cells, learnt / nominal, scan->values[SPILLS],
                                &scan->after->trust); /* there are no spills yet */
}

/* Kalman correction of the cells that were seen; leaves their gains, 0 for the others. */
static INLINED void correct(size_t count, const Cells *cells, const uint8_t *seen, double *restrict gains,
                            double *restrict height, double *restrict variance) {
    double is_seen[CARRIED];
    for (size_t k = 0; k < count; k++)
        is_seen[k] = seen[k] ? 1.0 : 0.0;
    for (size_t k = 0; k < count; k++) {
        const double predicted = cells->predicted[k], reading = cells->scan[k], known = cells->spread[k];
        const double off = reading - predicted, surprise = off * off, error = cells->error[k];
        const double wide = surprise > SURPRISE * SURPRISE * (known + error) ? surprise : known;
        const double share = wide / (wide + error), gain = error == 0.0 ? 1.0 : share;
        const double corrected = predicted + gain * off, left = (1.0 - gain) * wide;
        gains[k] = is_seen[k] != 0.0 ? gain : 0.0;
        height[k] = is_seen[k] != 0.0 ? (error == 0.0 ? reading : corrected) : predicted;
        variance[k] = is_seen[k] != 0.0 ? (error == 0.0 ? 0.0 : left) : known;
    }
}

static INLINED void count_unseen(size_t count, const uint8_t *seen, const int32_t *before, int32_t *restrict after) {
    for (size_t k = 0; k < count; k++)
        after[k] = (before[k] + 1) & (seen[k] ? 0 : -1);
}

/* What is reckoned in grows by the share of the volume that came. */
static INLINED void reckon(size_t count, const double *before, double volume, double *restrict after) {
    for (size_t k = 0; k < count; k++)
        after[k] = before[k] + volume * (after[k] - before[k]);
}

/* Evidence of dead cells after the layer; returns how many come alive again. */
static INLINED size_t carry_dead(const ScanUpdate *scan, size_t first, size_t count, const double *own,
                                 const Cells *cells) {
    const double *before = scan->before->dead_evidence + first;
    double *after = scan->after->dead_evidence + first, variance[CARRIED];
    if (scan->is_dry) {
        memcpy(after, before, count * sizeof *after);
        return 0;
    }
    for (size_t k = 0; k < count; k++)
        variance[k] = cells->spread[k] + cells->error[k];
    dead_evidence(count, before, own, cells->grown, variance, after);
    uint8_t revived[CARRIED];
    for (size_t k = 0; k < count; k++)
        revived[k] = (before[k] >= DEAD_EVIDENCE) & (after[k] < DEAD_EVIDENCE);
    return count_marked(revived, count);
}

/* The ends of the lists of squares of residuals: in variances, of cells with a droplet, and others [m^2]. */
typedef struct {
    double *droplets, *spills;
} Residuals;

static INLINED void append_residuals(const ScanUpdate *scan, size_t first, size_t count, const Cells *cells,
                                     Residuals *ends, ChunkSums *sums) {
    const int32_t *pattern = scan->layer->pattern + first;
    uint8_t reached[CARRIED], spilt[CARRIED];
    double square[CARRIED], share[CARRIED], variance[CARRIED];
    mark_reached(scan, first, count, cells, reached);
    const double volume = scan->volume;
    for (size_t k = 0; k < count; k++) {
        const double known = cells->known[k], rest = cells->scan[k] - known - volume * (cells->predicted[k] - known);
        variance[k] = cells->spread[k] + cells->error[k];
        square[k] = rest * rest;
        share[k] = square[k] / variance[k];
    }
    for (size_t k = 0; k < count; k++) {
        spilt[k] = reached[k] & (pattern[k] == 0);
        reached[k] &= pattern[k] > 0;
    }
    for (size_t k = 0; k < count; k++)
        variance[k] = spilt[k] ? variance[k] : 0.0;
    sums->variance += lane_sum(variance, count);
    ends->droplets = append(share, reached, count, ends->droplets);
    ends->spills = append(square, spilt, count, ends->spills);
}

/* Corrects cells, and carries what is known of them and of their errors on. */
static INLINED void correct_rows(void *context, const RowRange *range) {
    ScanUpdate *scan = context;
    const SurfaceEstimate *before = scan->before, *after = scan->after;
    const size_t ny = scan->options->ny, all = scan->options->nx * ny;
    const RegisteredScan *found = scan->registered;
    size_t wall = found->columns.before[range->chunk];
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t begin = chunk_row(scan->options->nx, chunk) * ny;
        const size_t end = chunk_row(scan->options->nx, chunk + 1) * ny;
        Residuals ends = {scan->values[DROPLETS] + begin, scan->values[SPILLS] + begin};
        ChunkSums *sums = &scan->sums[chunk];
        for (size_t first = begin; first < end; first += CARRIED) {
            const size_t count = end - first < CARRIED ? end - first : CARRIED;
            double own[CARRIED], gain[CARRIED];
            Cells cells; /* what follows comes in the place of some of the maps that these are of */
            memcpy(own, scan->increments->own + first, count * sizeof *own);
            take_cells(scan, first, count, own, &cells);
            sums->revived += carry_dead(scan, first, count, own, &cells);
            if (is_telling(scan))
                append_residuals(scan, first, count, &cells, &ends, sums);
            correct(count, &cells, found->seen + first, gain, after->height + first, after->variance + first);
            if (registers_scans(scan->options))
                carry_response(all, first, count, found, &wall, before->response, gain, after->response,
                               is_displaced(&after->registration) ? after->variance + first : NULL);
            count_unseen(count, found->seen + first, before->unseen + first, after->unseen + first);
            reckon(count, before->reckoned + first, after->trust.volume, after->reckoned + first);
        }
        sums->droplets = (size_t)(ends.droplets - (scan->values[DROPLETS] + begin));
        sums->spills = (size_t)(ends.spills - (scan->values[SPILLS] + begin));
    }
}

CLONED_ROW_WORK(correct_range, correct_rows)

/* How well the prediction explains what cells grew by. */
static void learn_residuals(ScanUpdate *scan) {
    const size_t nx = scan->options->nx, ny = scan->options->ny;
    const ChunkSums all = sum_of_chunks(scan);
    LoopTrust *trust = &scan->after->trust;
    ValueLists droplets = {.nx = nx, .ny = ny, .map = scan->values[DROPLETS]};
    ValueLists spills = {.nx = nx, .ny = ny, .map = scan->values[SPILLS]};
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        droplets.lengths[chunk] = scan->sums[chunk].droplets;
        spills.lengths[chunk] = scan->sums[chunk].spills;
    }
    if (add_residuals(&droplets, all.droplets, all.built < HALF * all.wanted, scan->values[ROOM], trust))
        add_spill(&spills, all.spills, all.variance / (double)all.spills, scan->values[ROOM], trust);
}

size_t correct_cells(ScanUpdate *scan) {
    on_all_rows(correct_range, scan);
    if (!registers_scans(scan->options))
        memset(scan->after->response, 0, DISPLACEMENTS * scan->options->nx * scan->options->ny * sizeof(double));
    if (is_telling(scan))
        learn_residuals(scan);
    return sum_of_chunks(scan).revived;
}
