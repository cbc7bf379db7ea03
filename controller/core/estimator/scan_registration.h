/* Where a sensor really looks: shift of a scan against the printer, and width of its spot, found from prediction
 * against scan.
 *
 * Walls show both: a shift of a quarter of a cell moves readings there by a quarter of the wall. An extended Kalman
 * filter holds the shift of the last scan (a random walk whose steps are learnt) and the spread of the spot next to the
 * heights. The heights' errors correlate with theirs: a height that was taken from a displaced scan is wrong by slope
 * times error of the shift. That part is kept as `response`, a map for each of the three, so that heights are corrected
 * later, when the shift is known better, and so that growth alone, which the same shift moved before and after, is no
 * new evidence of it (Schmidt 1966: errors that are considered; here they are estimated). What the model of the scan
 * leaves unexplained grows with the curvature of the surface; its size is learnt, and takes weight from readings at
 * walls, where the prediction then counts.
 *
 * Scans are taken as they are until the evidence is beyond doubt: a sensor in register stays one. */
#ifndef INKLOOP_SCAN_REGISTRATION_H
#define INKLOOP_SCAN_REGISTRATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "displaced_scan.h"

enum { SHIFT_X, SHIFT_Y, SPREAD, DISPLACEMENTS };

typedef struct {
    double estimate[DISPLACEMENTS];                   /* of the last scan [cells, cells, cells^2] */
    double covariance[DISPLACEMENTS * DISPLACEMENTS]; /* of its error */
    double applied[DISPLACEMENTS];                    /* what the heights stand corrected for; 0 before the evidence */
    double steps_variance;                            /* learnt: of the shift from scan to scan [cells^2] */
    double misfit;                                    /* learnt: variance of a reading per squared curvature [1] */
    double far_product, far_information; /* of readings beyond the reach of droplets: what a spot spreads there [1], and
                                            how much it would for each unit of its spread [1 per cells^4] */
    int64_t scans;                       /* that it is learnt from */
    int32_t has_shift;                   /* whether scans are corrected for a shift, */
    int32_t has_wide_spot;               /* and for a spot */
} Registration;

/* What is reported of it [cells]: the shift of the last scan, the larger standard deviation of its two errors; the
 * standard deviation of the Gaussian spot, 0 while it cannot be distinguished from a point, and that of its error. */
typedef struct {
    double shift_x, shift_y, shift_std, spot_radius, spot_std;
} ScanDisplacement;

/* What is known of a surface before a scan; maps of nx * ny cells in C order. */
typedef struct {
    size_t nx, ny;
    const double *before, *predicted; /* heights before the layer and after it [m] */
    const double *spread;             /* variance of the prediction [m^2] */
    const double *response;           /* DISPLACEMENTS maps [m per unit of the estimate] */
    const double *scan;               /* [m] */
    const uint8_t *valid;
    const uint8_t *part;   /* cells that droplets fall on, and reach to their neighbours */
    double noise_variance; /* of a reading [m^2] */
    double unsure;         /* error of a growth from which on it shows neither ink nor dead cells [m] */
    bool is_first_layer;   /* the ink is not known yet */
    bool is_unknown;       /* it is not known how much of the layer was jetted: nothing is learnt */
    bool has_spot;         /* a spot is looked for: wider droplets would look alike */
} ScanEvidence;

/* The scan as a sensor in register would have read it, and the heights before the layer by what is known now. */
typedef struct {
    double *before, *scan; /* [m] */
    double *variance;      /* of a reading beyond its noise [m^2] */
    double *sensitivity;   /* DISPLACEMENTS maps: how its innovation goes with the displacement of the scan before */
    double *slopes;        /* two maps: ... and with the step of the shift to this one */
    uint8_t *seen;         /* cells that this scan has measured */
    uint8_t *clear;        /* those of them whose growth the displacement leaves sure */
    double previous[DISPLACEMENTS * DISPLACEMENTS]; /* error of the displacement before per error of the one now */
    double rest[DISPLACEMENTS * DISPLACEMENTS];     /* covariance of what that leaves of the former */
} RegisteredScan;

/* Before the first scan. */
Registration no_registration(void);

/* The displacement by which predicted scans are made before this one is read. */
Displacement expected_displacement(const Registration *registration);

/* What the first scan, a map of heights, makes of the response: all of its slopes. False if there is no memory. */
bool first_response(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double *response);

ScanDisplacement reported_displacement(const Registration *registration);

/* Whether scans are corrected. */
bool is_displaced(const Registration *registration);

/* The scan taken as it was read. */
void take_as_read(const ScanEvidence *evidence, RegisteredScan *registered);

/* Learns from a scan, and corrects it; false if there is no memory. */
bool register_scan(const ScanEvidence *evidence, Registration *registration, RegisteredScan *registered);

/* The response after the heights took the share `gain` of the innovation. What no displacement explains any longer is
 * added to their `variance` [m^2], if it is not NULL. */
void carry_response(size_t cells, const RegisteredScan *registered, const double *before, const double *gain,
                    double *response, double *variance);

/* Variance of a height through the error of the displacement [m^2]. */
double displacement_variance(const Registration *registration, const double *response, size_t cells, size_t cell);

#endif
