/* Offsets of whole lines of readings: a line profiler takes one exposure after the other, and vibrates in between.
 *
 * Along x or along y neighbours on bare ground then differ more than along the other axis (scan_datum.h). The offset of
 * each line is found from its cells that no droplet reaches, as a random effect, and taken off the scan. */
#ifndef INKLOOP_SCAN_LINES_H
#define INKLOOP_SCAN_LINES_H

#include "scan_fit.h"

/* Subtracts the offsets from the scan of the evidence, `scan`, if neighbours differ more along one axis; returns the
 * remaining variance of a reading [m^2]. neighbours: variances of a reading by those along x and along y [m^2]; slopes:
 * squared slopes of the prediction; near: cells that droplets may reach. */
double take_lines_off(const ScanEvidence *evidence, const double neighbours[2], const double *slopes,
                      const uint8_t *near, FitRoom *room, double *scan);

#endif
