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
 * Scans are taken as they are until the evidence is beyond doubt: a sensor in register stays one. A shift that leaves
 * readings unexplained must stay beyond doubt: else it is the droplets that differ, and scans are taken as they are. */
#ifndef INKLOOP_SCAN_REGISTRATION_H
#define INKLOOP_SCAN_REGISTRATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "displacement_filter.h"

/* What is reported of it [cells]: the shift of the last scan, the larger standard deviation of its two errors; the
 * standard deviation of the Gaussian spot, 0 while it cannot be distinguished from a point, and that of its error. */
typedef struct {
    double shift_x, shift_y, shift_std, spot_radius, spot_std;
} ScanDisplacement;

/* The scan as a sensor in register would have read it, and the heights before the layer by what is known now. */
typedef struct {
    const double *before, *scan; /* [m] */
    const double *misread;       /* variance of a reading beyond its noise [m^2]; NULL: none */
    const uint8_t *seen;         /* cells that this scan has measured */
    const uint8_t *clear;        /* those of them whose growth the displacement leaves sure */
    WallColumns columns;         /* how its innovation goes with the displacement before, and with the step of the shift
                                    to this scan */
    double previous[DISPLACEMENTS * DISPLACEMENTS]; /* error of the displacement before per error of the one now */
    double rest[DISPLACEMENTS * DISPLACEMENTS];     /* covariance of what that leaves of the former */
} RegisteredScan;

/* Before the first scan. */
Registration no_registration(void);

/* The displacement by which predicted scans are made before this one is read. */
Displacement expected_displacement(const Registration *registration);

ScanDisplacement reported_displacement(const Registration *registration);

/* Whether scans are corrected. */
bool is_displaced(const Registration *registration);

/* The scan taken as it was read; it points to the maps of the evidence. */
void take_as_read(const ScanEvidence *evidence, RegisteredScan *registered);

/* Learns from a scan, and corrects it; what is corrected stands in the moved maps of `room`, the columns in it. False
 * if the unknowns cannot be solved for, or there is no memory. */
bool register_scan(const ScanEvidence *evidence, Room *room, Registration *registration, RegisteredScan *registered);

/* Variance of a height through the error of the displacement [m^2]. */
double displacement_variance(const Registration *registration, const double response[DISPLACEMENTS]);

#endif
