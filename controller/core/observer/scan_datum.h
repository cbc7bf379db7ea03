/* The datum of a scan: offset, tilts and bows of the profiler's frame, from ground that no droplet reaches.
 *
 * A profiler is levelled anew for every scan, or a substrate bows while it is printed on: both move all readings
 * smoothly. The datum is fitted to cells four and more from the part, or two and more where those are few. The fit is
 * robust, and the variance of its prior is learnt over the scans: it shrinks for a profiler that keeps its frame.
 * Without ground there is no datum. */
#ifndef INKLOOP_SCAN_DATUM_H
#define INKLOOP_SCAN_DATUM_H

#include <string.h>

#include "surface_estimate.h"

static const double NU = 4.0;          /* degrees of freedom of a reading's error (Lange, Little, Taylor 1989) */
static const double NOISELESS = 1e-20; /* [m^2], the least variance of a reading: a tenth of a nanometre */

typedef struct {
    double term[DATUM_TERMS];                    /* coefficients of 1, u, w, u^2, u w, w^2 [m] */
    double precision[DATUM_TERMS * DATUM_TERMS]; /* inverse of their covariance */
    /* robust variance of the readings about it [m^2]; below 0: too few cells */
    double noise_variance;
    /* robust variance of a reading, by the differences of neighbours along x and along y [m^2] */
    double neighbours[2];
} ScanDatum;

/* Marks the cells that no droplet reaches; `marks` holds two maps. */
void mark_ground(size_t nx, size_t ny, const uint8_t *part, uint8_t *ground, uint8_t *marks);

/* The datum of a scan where the ground has the known height `height`, NULL: 0; `ground` NULL: all cells are ground.
 * spread: variances of the terms before the scan; noise: of a reading [m^2]. Maps of nx * ny cells in C order. */
ScanDatum scan_datum(size_t nx, size_t ny, const double *scan, const uint8_t *valid, const double *height,
                     const uint8_t *ground, const double spread[DATUM_TERMS], double noise);

/* Variance of the rounding of readings that are all multiples of one step [m^2]; 0: there is no such step. layer:
 * height of a layer [m]. */
double rounding_variance(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double layer);

/* Coefficients of 1, w, ... in a row: of the datum, and of its variance. */
enum { ROW_TERMS = 3, ROW_VARIANCE_TERMS = 5 };
void datum_of_row(const double term[DATUM_TERMS], double u, double row[ROW_TERMS]);
void datum_variance_of_row(const double *covariance, double u, double row[ROW_VARIANCE_TERMS]);

/* The datum at a place of the row [m]. */
static inline double datum_in_row(const double row[ROW_TERMS], double w) {
    return row[0] + w * (row[1] + w * row[2]);
}

/* The terms 1, u, w, u^2, u w, w^2. */
static inline void datum_terms(double u, double w, double term[DATUM_TERMS]) {
    const double all[DATUM_TERMS] = {1.0, u, w, u * u, u * w, w * w};
    memcpy(term, all, sizeof all);
}

/* Coordinate of a row or column: -1 to 1 over the grid. */
static inline double place_on(size_t at, size_t count) {
    return count > 1 ? 2.0 * (double)at / ((double)count - 1.0) - 1.0 : 0.0;
}

#endif
