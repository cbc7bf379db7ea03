/* The offsets of whole lines of readings: a line profiler takes one exposure after the other, and shakes in between.
 *
 * Along x or along y neighbours on bare ground then differ more than along the other axis (scan_datum.h). The offset of
 * each line is found from its cells that no droplet reaches, as a random effect, and taken off the scan. */
#ifndef INKLOOP_SCAN_LINES_H
#define INKLOOP_SCAN_LINES_H

#include <stddef.h>
#include <stdint.h>

/* A scan on which lines are looked for; maps of nx * ny cells in C order. */
typedef struct {
    size_t nx, ny;
    const double *expected;          /* what its readings show without noise [m] */
    const double *variance, *slopes; /* of the heights [m^2], and their squared slopes [m^2 per cell^2] */
    const uint8_t *valid, *near;     /* readings; cells that droplets may reach */
    double noise;                    /* of a reading within its line [m^2] */
    double shift_variance;           /* of the place of a reading [cells^2] */
    double excess;                   /* variance of the offsets: above 0 lines have the same i, below 0 the same j */
} LineSearch;

/* Takes the offsets off the valid readings; `room` holds 2 max(nx, ny) values. Returns the mean variance that is left
 * of them [m^2]. */
double take_lines_off(const LineSearch *search, double *scan, double *room);

#endif
