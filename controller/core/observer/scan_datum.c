/* The datum of a scan: offset, tilts and bows of the profiler's frame, from ground that no droplet reaches.
 *
 * A profiler is levelled anew for every scan, or a substrate bows while it is printed on: both move all readings
 * smoothly. The datum is fitted to cells four and more from the part, or two and more where those are few. The fit is
 * robust, and the variance of its prior is learnt over the scans: it shrinks for a profiler that keeps its frame.
 * Without ground there is no datum. */
#include "scan_fit.h"

#include <math.h>
#include <stdlib.h>

#include "median.h"
#include "small_algebra.h"

static const double SURELY = 1e-30; /* variance of absent terms [m^2] */
/* least step of quantised readings in layers; tolerance as a share of a step (assumed) */
static const double LEAST_STEP = 0.02, SAME_STEP = 0.01;
enum { ROUNDS = 6, LEAST_CELLS = 20, CELLS_MAX = 1024, LEAST_ROUNDED = 64, LEAST_LEVELS = 6 };

/* share of the noise within a line that the offsets of lines must exceed: less is chance (assumed) */
static const double LINES_TELL = 0.5;

/* The ground: cells that are not near the part. */
static void take_rest(void *context, const RowRange *range) {
    const ScanEvidence *evidence = context;
    uint8_t *ground = evidence->ground;
    size_t found = 0;
    for (size_t cell = range->top * evidence->ny; cell < range->bottom * evidence->ny; cell++)
        found += ground[cell] = !ground[cell];
    evidence->sums[range->chunk].count[0] = found;
}

void mark_ground(const ScanEvidence *evidence) {
    const size_t cells = evidence->cells;
    uint8_t *marks = evidence->marks, *ground = evidence->ground;
    const uint8_t *from[] = {evidence->options->part, marks, marks + cells};
    uint8_t *into[] = {marks, marks + cells, ground};
    for (size_t k = 0; k < 3; k++)
        mark_near(evidence, from[k], into[k]);
    const size_t found = over_rows(evidence, take_rest, evidence).count[0];
    for (size_t cell = 0; found < LEAST_CELLS && cell < cells; cell++)
        ground[cell] = !marks[cell];
}

/* Measured cells of the ground. */
typedef struct {
    size_t count, cell[CELLS_MAX];
    double term[CELLS_MAX][DATUM_TERMS], rise[CELLS_MAX], rest[CELLS_MAX], sorted[CELLS_MAX];
} Ground;

/* A scan and the ground that it is compared with, as in scan_datum. */
typedef struct {
    size_t nx, ny;
    const double *scan, *height;
    const uint8_t *valid, *ground;
} GroundScan;

static bool is_ground(const GroundScan *of, size_t cell) {
    return of->valid[cell] && (!of->ground || of->ground[cell]);
}

/* Residual of a reading above the ground with that datum. */
static double rest_of(const GroundScan *of, const double term[DATUM_TERMS], size_t cell) {
    const double u = place_on(cell / of->ny, of->nx), w = place_on(cell % of->ny, of->ny);
    return of->scan[cell] - (of->height ? of->height[cell] : 0.0) - datum_at(term, u, w);
}

/* Samples the cells at even distances, if there are many. */
static void collect(const ScanEvidence *evidence, const GroundScan *of, Ground *cells) {
    cells->count = sample_cells(evidence, of->valid, of->ground, LEAST_CELLS, CELLS_MAX, cells->cell);
    for (size_t k = 0; k < cells->count; k++) {
        const size_t cell = cells->cell[k];
        datum_terms(place_on(cell / of->ny, of->nx), place_on(cell % of->ny, of->ny), cells->term[k]);
        cells->rise[k] = rest_of(of, (const double[DATUM_TERMS]){0.0}, cell);
    }
}

/* The normal equations of cells whose errors have a t distribution of scale `scale`. */
static void normal_equations(const Ground *cells, double scale, bool is_first, double noise,
                             const double spread[DATUM_TERMS], double *matrix, double side[DATUM_TERMS]) {
    memset(matrix, 0, DATUM_TERMS * DATUM_TERMS * sizeof *matrix);
    memset(side, 0, DATUM_TERMS * sizeof *side);
    for (size_t cell = 0; cell < cells->count; cell++) {
        const double *term = cells->term[cell], square = cells->rest[cell] * cells->rest[cell];
        const double weight = (is_first ? 1.0 : (NU + 1.0) / (NU + square / scale)) / noise;
        for (size_t i = 0; i < DATUM_TERMS; i++) {
            side[i] += weight * term[i] * cells->rise[cell];
            for (size_t j = 0; j < DATUM_TERMS; j++)
                matrix[i * DATUM_TERMS + j] += weight * term[i] * term[j];
        }
    }
    for (size_t i = 0; i < DATUM_TERMS; i++)
        matrix[i * DATUM_TERMS + i] += 1.0 / spread[i];
}

/* Variance of a normal variable by its squares, a few larger ones left out; reorders them. */
static double variance_of(double *squares, size_t count) {
    return variance_within(squares, count, fmax(median(squares, count) / MEDIAN_SQUARE, NOISELESS));
}

/* Degrees of freedom that the datum leaves to the readings, by the part of each term that its prior does not give. */
static double freedom_left(size_t count, const double *precision, const double spread[DATUM_TERMS]) {
    double covariance[DATUM_TERMS * DATUM_TERMS], left = (double)count - DATUM_TERMS;
    if (invert_definite(DATUM_TERMS, precision, covariance))
        for (size_t i = 0; i < DATUM_TERMS; i++)
            left += covariance[i * DATUM_TERMS + i] / spread[i];
    return left;
}

/* Variance of a reading by the differences of neighbours along an axis [m^2]; with too few pairs that of all
 * readings. */
static double neighbours_variance(const GroundScan *of, size_t axis, const double term[DATUM_TERMS], double all,
                                  Ground *cells) {
    size_t count = 0;
    for (size_t k = 0; k < cells->count; k++) {
        const size_t i = cells->cell[k] / of->ny + (axis == 0);
        const size_t j = cells->cell[k] % of->ny + (axis == 1), other = i * of->ny + j;
        if (i == of->nx || j == of->ny || !is_ground(of, other))
            continue;
        const double rest = rest_of(of, term, other) - cells->rest[k];
        cells->sorted[count++] = 0.5 * rest * rest;
    }
    return count < LEAST_CELLS ? all : variance_of(cells->sorted, count);
}

ScanDatum scan_datum(const ScanEvidence *evidence, const double *scan, const uint8_t *valid, const double *height,
                     const uint8_t *ground, double noise) {
    ScanDatum datum = {.noise.variance = -1.0};
    for (size_t i = 0; i < DATUM_TERMS; i++)
        datum.precision[i * DATUM_TERMS + i] = 1.0 / SURELY;
    Ground cells;
    double matrix[DATUM_TERMS * DATUM_TERMS], found = 0.0, scale = 0.0, variance = fmax(noise, NOISELESS);
    const GroundScan of = {evidence->nx, evidence->ny, scan, height, valid, ground};
    collect(evidence, &of, &cells);
    for (int round = 0; cells.count >= LEAST_CELLS && round < ROUNDS; round++) {
        double term[DATUM_TERMS];
        normal_equations(&cells, scale, round == 0, variance, evidence->known->datum_spread, matrix, term);
        if (!solve_definite(DATUM_TERMS, matrix, term))
            return datum;
        memcpy(datum.term, term, sizeof term);
        for (size_t cell = 0; cell < cells.count; cell++) {
            cells.rest[cell] = rest_of(&of, term, cells.cell[cell]);
            cells.sorted[cell] = cells.rest[cell] * cells.rest[cell];
        }
        found = variance_of(cells.sorted, cells.count);
        scale = fmax(found, NOISELESS);
        variance = fmax(0.5 * (variance + scale), NOISELESS);
    }
    if (cells.count < LEAST_CELLS)
        return datum;
    datum.noise.freedom = freedom_left(cells.count, matrix, evidence->known->datum_spread);
    datum.noise.variance = fmax(found * (double)cells.count / datum.noise.freedom, NOISELESS);
    for (size_t axis = 0; axis < 2; axis++)
        datum.noise.neighbours[axis] = neighbours_variance(&of, axis, datum.term, datum.noise.variance, &cells);
    memcpy(datum.precision, matrix, sizeof matrix);
    return datum;
}

static int by_size(const void *one, const void *other) {
    const double a = *(const double *)one, b = *(const double *)other;
    return (a > b) - (a < b);
}

double rounding_variance(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double layer) {
    const size_t distance = (nx * ny + CELLS_MAX - 1) / CELLS_MAX;
    double reading[CELLS_MAX], step = INFINITY;
    size_t count = 0, levels = 1;
    for (size_t cell = 0; cell < nx * ny && count < CELLS_MAX; cell += distance)
        if (valid[cell])
            reading[count++] = scan[cell];
    if (count < LEAST_ROUNDED)
        return 0.0;
    qsort(reading, count, sizeof *reading, by_size);
    for (size_t k = 1; k < count; k++)
        if (reading[k] > reading[k - 1]) {
            step = fmin(step, reading[k] - reading[k - 1]);
            levels++;
        }
    if (levels < LEAST_LEVELS || levels * 2 > count || !(step > LEAST_STEP * layer))
        return 0.0;
    for (size_t k = 1; k < count; k++) {
        const double steps = (reading[k] - reading[0]) / step;
        if (fabs(steps - round(steps)) > SAME_STEP)
            return 0.0;
    }
    return step * step / 12.0;
}

/* Offsets of whole lines of readings: a line profiler takes one exposure after the other, and vibrates in between.
 *
 * Along x or along y neighbours on bare ground then differ more than along the other axis (neighbours_variance). The
 * offset of each line is found from its cells that no droplet reaches, as a random effect, and taken off the scan. */
double take_lines_off(const ScanEvidence *evidence, const ReadingNoise *noise) {
    const EstimatorOptions *options = evidence->options;
    const size_t nx = options->nx, ny = options->ny;
    const double excess = noise->neighbours[0] - noise->neighbours[1], spread = fabs(excess);
    const double own = fmax(fmin(noise->neighbours[0], noise->neighbours[1]), fmax(options->steps_variance, NOISELESS));
    if (!(spread > LINES_TELL * own))
        return noise->variance;
    const bool is_along_y = excess > 0.0; /* lines have the same i */
    const size_t lines = is_along_y ? nx : ny;
    const Registration *registration = &evidence->known->registration;
    const double *seen = registration->estimate;
    double shift = fmax(registration->covariance[0], registration->covariance[GEOMETRY + 1]), left = 0.0, all = 0.0;
    if (!registration->is_displaced)
        shift += fmax(seen[SHIFT_X] * seen[SHIFT_X], seen[SHIFT_Y] * seen[SHIFT_Y]);
    if (!options->register_scans)
        shift = 0.0;
    const double *expected = read_map(evidence, evidence->predicted, evidence->averaged);
    const uint8_t *near = evidence->marks; /* cells that droplets may reach, from mark_ground */
    double *offset = evidence->spread_slope, *weight = evidence->lists[0], *reached = evidence->lists[1];
    for (size_t line = 0; line < lines; line++)
        offset[line] = weight[line] = reached[line] = 0.0;
    for (size_t cell = 0; cell < nx * ny; cell++) {
        const size_t line = is_along_y ? cell / ny : cell % ny;
        reached[line] += near[cell];
        if (!evidence->valid[cell] || near[cell])
            continue;
        const double rest = evidence->scan[cell] - expected[cell];
        const double within = own + evidence->variance[cell] + shift * evidence->slopes[cell], whole = within + spread;
        const double counts = (NU + 1.0) * whole / ((NU * whole + rest * rest) * within);
        offset[line] += counts * rest;
        weight[line] += counts;
    }
    for (size_t line = 0; line < lines; line++) {
        offset[line] /= weight[line] + 1.0 / spread;
        left += reached[line] / (weight[line] + 1.0 / spread);
        all += reached[line];
    }
    for (size_t cell = 0; cell < nx * ny; cell++)
        if (evidence->valid[cell])
            evidence->scan[cell] -= offset[is_along_y ? cell / ny : cell % ny];
    return own + (all > 0.0 ? left / all : 0.0);
}
