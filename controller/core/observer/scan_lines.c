#include "scan_lines.h"

#include <math.h>
#include <string.h>

static const double NU = 4.0; /* degrees of freedom of a reading's error (Lange, Little, Taylor 1989) */

double take_lines_off(const LineSearch *search, double *scan, double *room) {
    const size_t nx = search->nx, ny = search->ny, lines = search->excess > 0.0 ? nx : ny;
    const double spread = fabs(search->excess);
    double *offset = room, *weight = room + lines, *reached = room + 2 * lines, left = 0.0, all = 0.0;
    memset(room, 0, 3 * lines * sizeof *room);
    for (size_t cell = 0; cell < nx * ny; cell++) {
        const size_t line = search->excess > 0.0 ? cell / ny : cell % ny;
        reached[line] += search->near[cell];
        if (!search->valid[cell] || search->near[cell])
            continue;
        const double rest = scan[cell] - search->expected[cell];
        const double within = search->noise + search->variance[cell] + search->shift_variance * search->slopes[cell];
        const double whole = within + spread;
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
        if (search->valid[cell])
            scan[cell] -= offset[search->excess > 0.0 ? cell / ny : cell % ny];
    return all > 0.0 ? left / all : 0.0;
}
