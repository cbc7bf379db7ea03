#include "scan_lines.h"

#include <math.h>

/* share of the noise within a line that the offsets of lines must exceed: less is chance (assumed) */
static const double LINES_TELL = 0.5;

double take_lines_off(const ScanEvidence *evidence, const double neighbours[2], const double *slopes,
                      const uint8_t *near, FitRoom *room, double *scan) {
    const EstimatorOptions *options = evidence->options;
    const size_t nx = options->nx, ny = options->ny;
    const double excess = neighbours[0] - neighbours[1], spread = fabs(excess);
    const double noise = fmax(fmin(neighbours[0], neighbours[1]), fmax(options->steps_variance, NOISELESS));
    if (!(spread > LINES_TELL * noise))
        return evidence->noise_variance;
    const bool is_along_y = excess > 0.0; /* lines have the same i */
    const size_t lines = is_along_y ? nx : ny;
    const Registration *registration = &evidence->known->registration;
    const double *seen = registration->estimate, *expected = room->averaged;
    double shift = fmax(registration->covariance[0], registration->covariance[GEOMETRY + 1]), left = 0.0, all = 0.0;
    if (!registration->is_displaced)
        shift += fmax(seen[SHIFT_X] * seen[SHIFT_X], seen[SHIFT_Y] * seen[SHIFT_Y]);
    if (!options->register_scans)
        shift = 0.0;
    read_map(registration, nx, ny, evidence->predicted, room->spread_slope, room->lists[0], room->averaged);
    double *offset = room->spread_slope, *weight = room->lists[0], *reached = room->lists[1];
    for (size_t line = 0; line < lines; line++)
        offset[line] = weight[line] = reached[line] = 0.0;
    for (size_t cell = 0; cell < nx * ny; cell++) {
        const size_t line = is_along_y ? cell / ny : cell % ny;
        reached[line] += near[cell];
        if (!evidence->valid[cell] || near[cell])
            continue;
        const double rest = scan[cell] - expected[cell];
        const double within = noise + evidence->variance[cell] + shift * slopes[cell], whole = within + spread;
        const double counts = (NU + 1.0) * whole / ((NU * whole + rest * rest) * within);
        offset[line] += counts * rest;
        weight[line] += counts;
    }
    for (size_t line = 0; line < lines; line++) {
        offset[line] /= weight[line] + 1.0 / spread;
        left += reached[line] / (weight[line] + 1.0 / spread);
        all += reached[line];
    }
    for (size_t cell = 0; cell < nx * ny; cell++)
        if (evidence->valid[cell])
            scan[cell] -= offset[is_along_y ? cell / ny : cell % ny];
    return noise + (all > 0.0 ? left / all : 0.0);
}
