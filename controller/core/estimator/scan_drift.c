#include "scan_drift.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "median.h"
#include "near_cells.h"
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

double drift_at(const ScanDrift *drift, size_t nx, size_t ny, size_t cell) {
    double term[PLANE_TERMS];
    place_of_cell(nx, ny, cell, term);
    return plane_at(drift->coefficients, term);
}

/* The normal equations of weights 1 / max(distance, least), or of all cells within `furthest` alike. */
static void normal_equations(const References *cells, size_t terms, double least, double furthest, double *matrix,
                             double *side) {
    memset(matrix, 0, terms * terms * sizeof(double));
    memset(side, 0, terms * sizeof(double));
    for (size_t k = 0; k < cells->count; k++) {
        const double term[PLANE_TERMS] = {1.0, cells->x[k], cells->y[k]};
        if (cells->distance[k] > furthest)
            continue;
        const double weight = least > 0.0 ? least / fmax(cells->distance[k], least) : 1.0;
        for (size_t i = 0; i < terms; i++) {
            side[i] += weight * term[i] * cells->rise[k];
            for (size_t j = 0; j < terms; j++)
                matrix[i * terms + j] += weight * term[i] * term[j];
        }
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

/* Least absolute values by reweighting, then least squares without the outliers; returns the limit of those kept. */
static double fit_robustly(const References *cells, size_t terms, double coefficients[PLANE_TERMS]) {
    double least = 0.0;
    for (size_t k = 0; k < cells->count; k++)
        cells->distance[k] = 0.0;
    for (int round = 0; round < ROUNDS; round++) {
        fit(cells, terms, least, INFINITY, coefficients);
        for (size_t k = 0; k < cells->count; k++) {
            const double term[PLANE_TERMS] = {1.0, cells->x[k], cells->y[k]};
            cells->distance[k] = fabs(cells->rise[k] - plane_at(coefficients, term));
        }
        least = fmax(0.1 * median_distance(cells), ROUNDING);
    }
    const double furthest = fmax(OUTLIER * MAD * median_distance(cells), ROUNDING);
    fit(cells, terms, 0.0, furthest, coefficients);
    return furthest;
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
    for (size_t cell = 0; cell < nx * ny; cell++) {
        double term[PLANE_TERMS], leverage = 0.0;
        if (!part[cell])
            continue;
        place_of_cell(nx, ny, cell, term);
        for (size_t i = 0; i < terms; i++)
            for (size_t j = 0; j < terms; j++)
                leverage += term[i] * inverse[i][j] * term[j];
        if (leverage > LEVERAGE_MAX)
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

ScanDrift scan_drift(size_t nx, size_t ny, const uint8_t *part, const double *scan, const double *known,
                     const uint8_t *valid, double *scratch) {
    const size_t count = nx * ny;
    References cells = {0, scratch, scratch + count, scratch + 2 * count, scratch + 3 * count, scratch + 4 * count};
    for (size_t cell = 0; cell < count; cell++) {
        double term[PLANE_TERMS];
        if (!valid[cell] || is_near_marked(part, nx, ny, cell))
            continue;
        place_of_cell(nx, ny, cell, term);
        cells.x[cells.count] = term[1];
        cells.y[cells.count] = term[2];
        cells.rise[cells.count++] = scan[cell] - known[cell];
    }
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
