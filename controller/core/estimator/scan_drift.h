/* Movement of the sensor's frame between two scans, measured on cells that no droplet reaches.
 *
 * They are two cells and more from the part. What they were at first may be uneven or tilted and stays; only what has
 * changed since is the sensor's. An offset there was in the very first scan cannot be distinguished from the substrate.
 * A plane is fitted where the cells surround the part well enough, an offset where they do not, and nothing where there
 * are hardly any: a part that fills the grid leaves drift in the heights. */
#ifndef INKLOOP_SCAN_DRIFT_H
#define INKLOOP_SCAN_DRIFT_H

#include <stddef.h>
#include <stdint.h>

enum { PLANE_TERMS = 3, DRIFT_MAPS = 5 };

typedef struct {
    double coefficients[PLANE_TERMS]; /* offset and rise over the longer side of the grid, along x and y [m] */
    double residual_variance;         /* of the reference cells about the plane [m^2]; below 0: too few cells */
} ScanDrift;

/* Drift in a `scan` of a surface that is `known` at the reference cells [m]; maps of nx * ny cells in C order.
 * `reached`: cells of the `part` and next to it; `scratch` holds DRIFT_MAPS maps. */
ScanDrift scan_drift(size_t nx, size_t ny, const uint8_t *part, const uint8_t *reached, const double *scan,
                     const double *known, const uint8_t *valid, double *const scratch[DRIFT_MAPS]);

/* The `scan` without its drift [m]; cells that were not `valid` as if 0 had been measured. Its bits do not depend on
 * the threads. */
void take_drift_off(const ScanDrift *drift, size_t nx, size_t ny, size_t threads, const double *measured,
                    const uint8_t *valid, double *scan);

#endif
