#include "scan.h"

#include <math.h>

static const double SPOT_REACH = 4.0; /* standard deviations; beyond lies 6e-5 of the weight */

/* Weighted mean over the neighbours of place `at` in a line of `length` values, `stride` apart. */
static double line_mean(const double *line, size_t length, size_t stride, size_t at, double pitch, double radius) {
    const double cells = floor(SPOT_REACH * radius / pitch);
    const size_t reach = cells < (double)length ? (size_t)cells : length;
    const size_t first = at > reach ? at - reach : 0, last = at + reach < length ? at + reach : length - 1;
    double sum = 0.0, weights = 0.0;
    for (size_t k = first; k <= last; k++) {
        const double ratio = ((double)k - (double)at) * pitch / radius;
        const double weight = exp(-0.5 * ratio * ratio);
        sum += weight * line[k * stride];
        weights += weight;
    }
    return sum / weights;
}

void average_over_spot(const double *height, double *average, double *lines, size_t nx, size_t ny, double pitch,
                       double radius) {
    for (size_t i = 0; i < nx; i++)
        for (size_t j = 0; j < ny; j++)
            lines[i * ny + j] = line_mean(height + i * ny, ny, 1, j, pitch, radius);
    for (size_t i = 0; i < nx; i++)
        for (size_t j = 0; j < ny; j++)
            average[i * ny + j] = line_mean(lines + j, nx, ny, i, pitch, radius);
}

/* The cell before a place on a line of `length` cells, and the distance beyond it [cells]. */
static size_t cell_before(double place, size_t length, double *beyond) {
    const double last = (double)length - 1.0, inside = place < 0.0 ? 0.0 : place > last ? last : place;
    const size_t cell = (size_t)inside;
    *beyond = inside - (double)cell;
    return cell;
}

void displace(const double *height, double *displaced, size_t nx, size_t ny, double pitch, double x, double y) {
    for (size_t i = 0; i < nx; i++) {
        for (size_t j = 0; j < ny; j++) {
            double share_x, share_y;
            const size_t row = cell_before((double)i + x / pitch, nx, &share_x),
                         next_row = row + 1 < nx ? row + 1 : row;
            const size_t column = cell_before((double)j + y / pitch, ny, &share_y);
            const size_t next = column + 1 < ny ? column + 1 : column;
            const double low = (1.0 - share_y) * height[row * ny + column] + share_y * height[row * ny + next];
            const double high =
                (1.0 - share_y) * height[next_row * ny + column] + share_y * height[next_row * ny + next];
            displaced[i * ny + j] = (1.0 - share_x) * low + share_x * high;
        }
    }
}

static double difference(const double *line, size_t length, size_t stride, size_t at, double pitch) {
    const size_t low = at > 0 ? at - 1 : at, high = at + 1 < length ? at + 1 : at;
    if (high == low)
        return 0.0;
    return (line[high * stride] - line[low * stride]) / ((double)(high - low) * pitch);
}

double slope_at(const double *height, size_t nx, size_t ny, size_t i, size_t j, double pitch) {
    const double along_x = difference(height + j, nx, ny, i, pitch);
    const double along_y = difference(height + i * ny, ny, 1, j, pitch);
    return sqrt(along_x * along_x + along_y * along_y);
}
