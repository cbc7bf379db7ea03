#include "scan_drift.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "median.h"
#include "row_ranges.h"
#include "small_algebra.h"

static const double LEVERAGE_MAX = 0.25; /* variance that the plane may bring to a cell of the part (assumed) */
static const double OUTLIER = 3.0;       /* robust standard deviations from which on a cell is left out */
static const double MAD = 1.4826;        /* standard deviation / median absolute value of a normal variable */
static const double ROUNDING = 1e-12;    /* [m], heights that agree to this are equal */
enum { ROUNDS = 8 };                     /* of reweighting; they more than suffice for a plane (by trial) */
enum { LEAST_CELLS = 8 };                /* cells needed to estimate the noise (assumed) */
enum { LEAST_REFERENCES = 3 };

/* The reference cells that were seen: their places, what they rose by, and their distances from a plane. */
typedef struct {
    size_t count;
    double *x, *y, *rise, *distance, *sorted;
} References;

static void place_of_cell(size_t nx, size_t ny, size_t cell, double term[PLANE_TERMS]) {
    const double longer = (double)(nx > ny ? nx : ny);
    term[0] = 1.0;
    term[1] = (double)(cell / ny) / longer - 0.5;
    term[2] = (double)(cell % ny) / longer - 0.5;
}

static double plane_at(const double coefficients[PLANE_TERMS], const double term[PLANE_TERMS]) {
    return coefficients[0] + coefficients[1] * term[1] + coefficients[2] * term[2];
}

/* What the threads share that take a drift off. */
typedef struct {
    const ScanDrift *drift;
    size_t nx, ny;
    const double *measured;
    const uint8_t *valid;
    double *scan;
} Leveling;

static INLINED void level_rows(void *context, const RowRange *range) {
    const Leveling *work = context;
    const size_t ny = work->ny;
    const double longer = (double)(work->nx > ny ? work->nx : ny), *coefficients = work->drift->coefficients;
    for (size_t i = range->top; i < range->bottom; i++) {
        const double along_row = coefficients[0] + coefficients[1] * ((double)i / longer - 0.5);
        const double along_columns = coefficients[2], *reading = work->measured + i * ny;
        const uint8_t *seen = work->valid + i * ny;
        double *restrict row = work->scan + i * ny;
        for (int32_t j = 0; j < (int32_t)ny; j++) {
            const double read = seen[j] ? reading[j] : 0.0;
            row[j] = read - (along_row + along_columns * ((double)j / longer - 0.5));
        }
    }
}

CLONED_ROW_WORK(level_range, level_rows)

void take_drift_off(const ScanDrift *drift, size_t nx, size_t ny, size_t threads, const double *measured,
                    const uint8_t *valid, double *scan) {
    Leveling work = {drift, nx, ny, measured, valid, scan};
    run_rows(threads, nx, ny, level_range, &work);
}

enum { BLOCK = 64 }; /* cells, so that their weights stay in the cache */

/* Weights of some cells. */
static void weigh(const References *cells, size_t first, size_t count, double least, double furthest,
                  double weight[BLOCK]) {
    const double *distance = cells->distance + first;
    for (size_t k = 0; k < count; k++)
        weight[k] = least > 0.0 ? least / (distance[k] > least ? distance[k] : least) : 1.0;
    for (size_t k = 0; k < count; k++)
        weight[k] = distance[k] > furthest ? 0.0 : weight[k];
}

/* The normal equations of weights 1 / max(distance, least), or of all cells within `furthest` alike. */
static void normal_equations(const References *cells, size_t terms, double least, double furthest, double *matrix,
                             double *side) {
    double sums[PLANE_TERMS][PLANE_TERMS + 1] = {{0.0}}, weight[BLOCK];
    for (size_t first = 0; first < cells->count; first += BLOCK) {
        const size_t count = cells->count - first < BLOCK ? cells->count - first : BLOCK;
        weigh(cells, first, count, least, furthest, weight);
        for (size_t k = 0; k < count; k++) {
            const double term[PLANE_TERMS + 1] = {1.0, cells->x[first + k], cells->y[first + k],
                                                  cells->rise[first + k]};
            for (size_t i = 0; i < PLANE_TERMS; i++)
                for (size_t j = 0; j <= PLANE_TERMS; j++)
                    sums[i][j] += weight[k] * term[i] * term[j];
        }
    }
    for (size_t i = 0; i < terms; i++) {
        side[i] = sums[i][PLANE_TERMS];
        for (size_t j = 0; j < terms; j++)
            matrix[i * terms + j] = sums[i][j];
    }
}

/* Least squares with these weights; false, and the coefficients as they were, if the cells do not carry it. */
static bool fit(const References *cells, size_t terms, double least, double furthest,
                double coefficients[PLANE_TERMS]) {
    double matrix[PLANE_TERMS * PLANE_TERMS], side[PLANE_TERMS];
    normal_equations(cells, terms, least, furthest, matrix, side);
    if (!solve_definite(terms, matrix, side))
        return false;
    memcpy(coefficients, side, terms * sizeof(double));
    return true;
}

static double median_distance(const References *cells) {
    memcpy(cells->sorted, cells->distance, cells->count * sizeof(double));
    return median(cells->sorted, cells->count);
}

static void take_distances(const References *cells, const double coefficients[PLANE_TERMS]) {
    const double c0 = coefficients[0], c1 = coefficients[1], c2 = coefficients[2];
    const double *x = cells->x, *y = cells->y, *rise = cells->rise;
    double *restrict distance = cells->distance;
    for (size_t k = 0; k < cells->count; k++)
        distance[k] = fabs(rise[k] - (c0 + c1 * x[k] + c2 * y[k]));
}

/* Least absolute values by reweighting, then least squares without the outliers; returns the limit of those kept. */
static double fit_robustly(const References *cells, size_t terms, double coefficients[PLANE_TERMS]) {
    double least = 0.0;
    for (size_t k = 0; k < cells->count; k++)
        cells->distance[k] = 0.0;
    for (int round = 0; round < ROUNDS; round++) {
        fit(cells, terms, least, INFINITY, coefficients);
        take_distances(cells, coefficients);
        least = fmax(0.1 * median_distance(cells), ROUNDING);
    }
    const double furthest = fmax(OUTLIER * MAD * median_distance(cells), ROUNDING);
    fit(cells, terms, 0.0, furthest, coefficients);
    return furthest;
}

/* Variance that a fit brings to a cell, in variances of a reading. */
static double leverage_at(size_t nx, size_t ny, size_t cell, size_t terms, double inverse[PLANE_TERMS][PLANE_TERMS]) {
    double term[PLANE_TERMS], leverage = 0.0;
    place_of_cell(nx, ny, cell, term);
    for (size_t i = 0; i < terms; i++)
        for (size_t j = 0; j < terms; j++)
            leverage += term[i] * inverse[i][j] * term[j];
    return leverage;
}

/* Whether a fit holds for the part: far cells in one corner constrain it little. */
static bool carries(const References *cells, size_t terms, size_t nx, size_t ny, const uint8_t *part) {
    double matrix[PLANE_TERMS * PLANE_TERMS], side[PLANE_TERMS], inverse[PLANE_TERMS][PLANE_TERMS] = {{0.0}};
    if (cells->count < LEAST_REFERENCES)
        return false;
    normal_equations(cells, terms, 0.0, INFINITY, matrix, side);
    for (size_t k = 0; k < terms; k++) {
        inverse[k][k] = 1.0;
        if (!solve_definite(terms, matrix, inverse[k]))
            return false;
    }
    for (size_t i = 0; i < nx; i++) {
        const uint8_t *row = part + i * ny;
        size_t first = 0, last = ny; /* the leverage is convex: greatest at one of the ends of a row */
        while (first < ny && !row[first])
            first++;
        if (first == ny)
            continue;
        while (!row[last - 1])
            last--;
        if (leverage_at(nx, ny, i * ny + first, terms, inverse) > LEVERAGE_MAX ||
            leverage_at(nx, ny, i * ny + last - 1, terms, inverse) > LEVERAGE_MAX)
            return false;
    }
    return true;
}

static double variance_about(const References *cells, size_t terms, const double coefficients[PLANE_TERMS],
                             double furthest) {
    double sum = 0.0;
    size_t kept = 0;
    for (size_t k = 0; k < cells->count; k++) {
        const double term[PLANE_TERMS] = {1.0, cells->x[k], cells->y[k]};
        const double residual = cells->rise[k] - plane_at(coefficients, term);
        if (cells->distance[k] > furthest)
            continue;
        sum += residual * residual;
        kept++;
    }
    return kept >= LEAST_CELLS ? sum / (double)(kept - terms) : -1.0;
}

/* Adds the reference cells of row i: they were seen, and lie beyond the reach of droplets. */
static void collect_row(size_t nx, size_t ny, size_t i, const uint8_t *reached, const double *scan, const double *known,
                        const uint8_t *valid, References *cells) {
    const uint8_t *row = reached + i * ny, *end = row + ny;
    for (const uint8_t *found = row; (found = memchr(found, 0, (size_t)(end - found))); found++) {
        const size_t cell = (size_t)(found - reached);
        double term[PLANE_TERMS];
        if (!valid[cell])
            continue;
        place_of_cell(nx, ny, cell, term);
        cells->x[cells->count] = term[1];
        cells->y[cells->count] = term[2];
        cells->rise[cells->count++] = scan[cell] - known[cell];
    }
}

ScanDrift scan_drift(size_t nx, size_t ny, const uint8_t *part, const uint8_t *reached, const double *scan,
                     const double *known, const uint8_t *valid, double *const scratch[DRIFT_MAPS]) {
    References cells = {0, scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]};
    for (size_t i = 0; i < nx; i++)
        collect_row(nx, ny, i, reached, scan, known, valid, &cells);
    ScanDrift drift = {{0.0}, -1.0};
    for (size_t k = 0; k < cells.count; k++)
        cells.distance[k] = 0.0;
    const size_t terms = carries(&cells, PLANE_TERMS, nx, ny, part) ? PLANE_TERMS
                         : carries(&cells, 1, nx, ny, part)         ? 1
                                                                    : 0;
    if (terms > 0) {
        const double furthest = fit_robustly(&cells, terms, drift.coefficients);
        drift.residual_variance = variance_about(&cells, terms, drift.coefficients, furthest);
    }
    return drift;
}
