/* Readings of a surface by a profile sensor, with all its errors. A grid is nx * ny cells in C order. */
#ifndef INKLOOP_READING_H
#define INKLOOP_READING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Parameters of a sensor, lengths in m; described in variables.toml. */
typedef struct {
    double pitch, noise_std, noise_correlation, resolution, bias, drift_rate, tilt_x, tilt_y, shift_x, shift_y,
        shift_std, spot_radius, slope_bias, dropout_slope, dropout_rate;
    int32_t seed;
} Instrument;

/* Scan number `scan` (from 0) of `surface`: a reading for each valid cell; the others are not written. `spot` and
 * `lines` are room for one grid each. */
void read_surface(const Instrument *instrument, const double *surface, size_t nx, size_t ny, int32_t scan, double *spot,
                  double *lines, double *reading, bool *valid);

#endif
