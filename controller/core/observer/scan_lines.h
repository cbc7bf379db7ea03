/* The offsets of whole lines of readings: a line profiler takes one exposure after the other, and shakes in between.
 *
 * Along x or along y neighbours on bare ground then differ more than along the other axis (scan_datum.h). The offset of
 * each line is found from its cells that no droplet reaches, as a random effect, and taken off the scan. */
#ifndef INKLOOP_SCAN_LINES_H
#define INKLOOP_SCAN_LINES_H

#include "scan_fit.h"

/* Takes the offsets off `scan`, which is that of the evidence, if neighbours tell; returns the variance that is left to
 * a reading [m^2]. neighbours: variances of a reading by those along x and along y [m^2]; slopes: their squares, of the
 * prediction; near: cells that droplets may reach. */
double take_lines_off(const ScanEvidence *evidence, const double neighbours[2], const double *slopes,
                      const uint8_t *near, FitRoom *room, double *scan);

#endif
