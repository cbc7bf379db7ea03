#include "reading.h"

#include "random.h"
#include "scan.h"

#include <math.h>

static double noise_at(const Instrument *by, size_t cell, int32_t scan, double common) {
    if (by->noise_std == 0.0)
        return 0.0;
    const double white = random_normal(by->seed, STREAM_WHITE_NOISE, cell, scan);
    return by->noise_std * (sqrt(by->noise_correlation) * common + sqrt(1.0 - by->noise_correlation) * white);
}

static bool is_lost(const Instrument *by, size_t cell, int32_t scan, double slope) {
    if (by->dropout_slope > 0.0 && slope > by->dropout_slope)
        return true;
    return by->dropout_rate > 0.0 && random_uniform(by->seed, STREAM_DROPOUT, cell, scan) < by->dropout_rate;
}

/* Tilt and offset of a misaligned sensor at cell (i, j). */
static double set_up_error(const Instrument *by, size_t nx, size_t ny, size_t i, size_t j, int32_t scan) {
    const double x = ((double)i - 0.5 * ((double)nx - 1.0)) * by->pitch;
    const double y = ((double)j - 0.5 * ((double)ny - 1.0)) * by->pitch;
    return by->tilt_x * x + by->tilt_y * y + by->bias + by->drift_rate * scan;
}

/* Displacement of the sensor along an axis, 0 or 1, in one scan [m]. */
static double shift_of_scan(const Instrument *by, uint64_t axis, int32_t scan) {
    const double scatter = by->shift_std > 0.0 ? random_normal(by->seed, STREAM_SHIFT, axis, scan) : 0.0;
    return (axis == 0 ? by->shift_x : by->shift_y) + by->shift_std * scatter;
}

/* Applies the errors in the order of the hardware: shift, spot, slope, noise, drop-out, tilt, bias, steps. */
void read_surface(const Instrument *by, const double *surface, size_t nx, size_t ny, int32_t scan, double *spot,
                  double *lines, double *reading, bool *valid) {
    const double shift_x = shift_of_scan(by, 0, scan), shift_y = shift_of_scan(by, 1, scan), *seen = surface;
    if (by->spot_radius > 0.0) {
        average_over_spot(surface, spot, lines, nx, ny, by->pitch, by->spot_radius);
        seen = spot;
    }
    if (shift_x != 0.0 || shift_y != 0.0) {
        displace(seen, lines, nx, ny, by->pitch, shift_x, shift_y);
        seen = lines;
    }
    const double common = random_normal(by->seed, STREAM_COMMON_NOISE, 0, scan);
    for (size_t i = 0; i < nx; i++) {
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            const double slope = slope_at(seen, nx, ny, i, j, by->pitch);
            const double sine_of_double_angle = 2.0 * slope / (1.0 + slope * slope);
            double value = seen[cell] + by->slope_bias * sine_of_double_angle + noise_at(by, cell, scan, common);
            value += set_up_error(by, nx, ny, i, j, scan);
            if (by->resolution > 0.0)
                value = rint(value / by->resolution) * by->resolution;
            valid[cell] = !is_lost(by, cell, scan, slope);
            if (valid[cell])
                reading[cell] = value;
        }
    }
}
