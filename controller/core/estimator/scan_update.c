#include "scan_update.h"

#include <math.h>
#include <string.h>

#include "dead_cells.h"
#include "layer_surface.h"
#include "near_cells.h"

static const double SURPRISE = 5.0; /* standard deviations off the prediction from which on the model of a cell is
                                       wrong, not the scan (by trial) */
static const double HALF = 0.5;     /* of the part */

/* Some cells of a scan, and what is known of them. */
typedef struct {
    const double *predicted, *misread; /* misread: NULL if there is none */
    const uint8_t *seen;
    double scan[CARRIED], spread[CARRIED]; /* spread: variance of the predictions [m^2] */
} CorrectedCells;

/* Kalman correction of the cells that were seen; leaves their gains, 0 for the others. */
static INLINED void correct(size_t count, const CorrectedCells *cells, double noise, double *restrict gains,
                            double *restrict height, double *restrict variance) {
    for (size_t k = 0; k < count; k++) {
        const double predicted = cells->predicted[k], reading = cells->scan[k], known = cells->spread[k];
        const double off = reading - predicted, surprise = off * off;
        const double error = noise + (cells->misread ? cells->misread[k] : 0.0);
        const double wide = surprise > SURPRISE * SURPRISE * (known + error) ? surprise : known;
        const double share = wide / (wide + error), gain = error == 0.0 ? 1.0 : share;
        const double corrected = predicted + gain * off, left = (1.0 - gain) * wide;
        gains[k] = cells->seen[k] ? gain : 0.0;
        height[k] = cells->seen[k] ? (error == 0.0 ? reading : corrected) : predicted;
        variance[k] = cells->seen[k] ? (error == 0.0 ? 0.0 : left) : known;
    }
}

void on_all_rows(RowWork *work, ScanUpdate *scan) {
    run_rows(scan->layer->threads, scan->layer->nx, scan->layer->ny, work, scan);
}

static size_t sum_of(const size_t counts[CHUNKS]) {
    size_t sum = 0;
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        sum += counts[chunk];
    return sum;
}

static INLINED void count_unseen(size_t count, const uint8_t *seen, const int32_t *before, int32_t *restrict after) {
    for (size_t k = 0; k < count; k++)
        after[k] = seen[k] ? 0 : before[k] + 1;
}

/* Corrects cells, and carries what is known of their errors on. */
static INLINED void correct_rows(void *context, const RowRange *range) {
    const ScanUpdate *scan = context;
    const SurfaceEstimate *before = scan->before, *after = scan->after;
    const size_t ny = scan->options->ny, cells = scan->options->nx * ny, end = range->bottom * ny;
    const RegisteredScan *found = scan->registered;
    size_t wall = found->columns.before[range->chunk];
    double gain[CARRIED];
    for (size_t first = range->top * ny; first < end; first += CARRIED) {
        const size_t count = end - first < CARRIED ? end - first : CARRIED;
        CorrectedCells some = {.predicted = scan->predicted + first,
                               .misread = found->misread ? found->misread + first : NULL,
                               .seen = found->seen + first};
        memcpy(some.scan, found->scan + first, count * sizeof(double)); /* the heights come in its place */
        predicted_variance(scan->variance, first, count, some.spread);
        correct(count, &some, scan->variance->noise, gain, after->height + first, after->variance + first);
        if (registers_scans(scan->options))
            carry_response(cells, first, count, found, &wall, before->response, gain, after->response,
                           is_displaced(&after->registration) ? after->variance + first : NULL);
        count_unseen(count, found->seen + first, before->unseen + first, after->unseen + first);
    }
}

CLONED_ROW_WORK(correct_range, correct_rows)

void correct_cells(ScanUpdate *scan) {
    on_all_rows(correct_range, scan);
    if (!registers_scans(scan->options))
        memset(scan->after->response, 0, DISPLACEMENTS * scan->options->nx * scan->options->ny * sizeof(double));
}

/* What the neighbours' droplets do not explain of the growth of cells, and what their own were to leave; leaves the
 * variances of the readings where the first rates were. */
static INLINED void look_for_dead_rows(void *context, const RowRange *range) {
    ScanUpdate *scan = context;
    const EstimatorOptions *options = scan->options;
    const size_t ny = options->ny, cells = options->nx * ny;
    const double *reading = scan->registered->scan, *known = scan->registered->before;
    const uint8_t *clear = scan->registered->clear, *part = options->part;
    double *restrict own = scan->increments->own, *restrict grown = scan->predicted, variance[CARRIED], added[CARRIED];
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t end = chunk_row(options->nx, chunk + 1) * ny;
        size_t part_cells = 0, dry = 0;
        for (size_t first = chunk_row(options->nx, chunk) * ny; first < end; first += CARRIED) {
            const size_t count = end - first < CARRIED ? end - first : CARRIED;
            innovation_variance(scan->variance, first, count, variance);
            added_heights(scan->increments, cells, first, count, options->ink.inks, scan->ink, added);
            for (size_t k = 0; k < count; k++) {
                const double left = own[first + k];
                grown[first + k] = reading[first + k] - known[first + k] - added[k] + left;
                own[first + k] = clear[first + k] ? left : 0.0;
                part_cells += part[first + k] != 0;
            }
            memcpy(scan->increments->rates + first, variance, count * sizeof(double));
            dry += count_dry(count, own + first, grown + first);
        }
        scan->part_cells[chunk] = part_cells;
        scan->dry[chunk] = dry;
    }
}

CLONED_ROW_WORK(look_for_dead, look_for_dead_rows)

static void add_dead_evidence(void *context, const RowRange *range) {
    const ScanUpdate *scan = context;
    const size_t first = range->top * scan->options->ny, count = range->bottom * scan->options->ny - first;
    if (scan->is_dry)
        memcpy(scan->after->dead_evidence + first, scan->before->dead_evidence + first, count * sizeof(double));
    else
        dead_evidence(count, scan->before->dead_evidence + first, scan->increments->own + first,
                      scan->predicted + first, scan->increments->rates + first, scan->after->dead_evidence + first);
}

void find_dead(ScanUpdate *scan) {
    on_all_rows(look_for_dead, scan);
    scan->is_dry = is_head_dry(sum_of(scan->dry), sum_of(scan->part_cells));
    on_all_rows(add_dead_evidence, scan);
}

/* Marks the cells of the part whose growth tells of droplets: measured, and no trials of dead cells, from which nothing
 * is expected; adds up the heights of the part. */
static INLINED void mark_telling_rows(void *context, const RowRange *range) {
    ScanUpdate *scan = context;
    const EstimatorOptions *options = scan->options;
    const RegisteredScan *found = scan->registered;
    const size_t ny = options->ny;
    uint8_t *telling = scan->marks, *trial = telling + options->nx * ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t end = chunk_row(options->nx, chunk + 1) * ny;
        size_t trials = 0;
        double built = 0.0, wanted = 0.0;
        for (size_t cell = chunk_row(options->nx, chunk) * ny; cell < end; cell++) {
            trial[cell] = (scan->layer->pattern[cell] > 0) & (scan->before->dead_evidence[cell] >= DEAD_EVIDENCE);
            trials += trial[cell];
            telling[cell] = (options->part[cell] != 0) & (found->clear[cell] != 0);
            built += options->part[cell] ? found->before[cell] : 0.0;
            wanted += options->part[cell] ? options->target[cell] : 0.0;
        }
        scan->trials[chunk] = trials;
        scan->built[chunk] = built;
        scan->wanted[chunk] = wanted;
    }
}

CLONED_ROW_WORK(mark_telling, mark_telling_rows)

/* Cells near the trials of dead cells tell nothing either. */
static void leave_out_trials(const ScanUpdate *scan) {
    const size_t nx = scan->options->nx, ny = scan->options->ny, cells = nx * ny;
    uint8_t *telling = scan->marks;
    if (sum_of(scan->trials) == 0)
        return;
    for (size_t cell = 0; cell < cells; cell++)
        telling[cell] = telling[cell] && !is_near_marked(telling + cells, nx, ny, cell);
}

void look_at_growth(ScanUpdate *scan) {
    const EstimatorOptions *options = scan->options;
    const size_t cells = options->nx * options->ny;
    double built = 0.0, wanted = 0.0, learnt = 0.0, nominal = 0.0, *rates = scan->increments->rates;
    on_all_rows(mark_telling, scan);
    leave_out_trials(scan);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        built += scan->built[chunk];
        wanted += scan->wanted[chunk];
    }
    const LayerGrowth growth = {cells,
                                sum_of(scan->part_cells),
                                scan->marks,
                                scan->layer->pattern,
                                scan->registered->before,
                                scan->registered->scan,
                                scan->predicted,
                                rates,
                                built < HALF * wanted};
    for (size_t k = 0; k < options->ink.inks; k++) {
        learnt += full_layer_height(&scan->after->ink[k]);
        nominal += full_layer_height(&options->ink.nominal[k]);
    }
    if (!options->take_as_read)
        add_residuals(&growth, learnt / nominal, rates + cells, &scan->after->trust);
}
