#include "displaced_scan.h"

#include <math.h>
#include <string.h>

static const double SPOT_REACH = 4.0;    /* standard deviations; 6e-5 of the weight lies beyond */
static const double SHIFT_STEP = 0.02;   /* of the difference quotients [cells]: centred, so that a kink is halved */
static const double SPREAD_STEP = 0.02;  /* ... [cells^2] */
static const double SPREAD_LEAST = 1e-9; /* [cells^2] below which a spot is a point */
enum { BISECTIONS = 48 };                /* of a radius: to the last digit that matters */
enum { TAPS_MAX = 64 };                  /* to each side; wider spots are cut off */

static double within(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

/* Weights of the cells 0, 1, ... away; returns the largest distance. */
static size_t spot_weights(double radius, double weights[TAPS_MAX + 1]) {
    const size_t reach = (size_t)within(floor(SPOT_REACH * radius), 1.0, TAPS_MAX);
    for (size_t k = 0; k <= reach; k++)
        weights[k] = exp(-0.5 * (double)(k * k) / (radius * radius));
    return reach;
}

static double weights_variance(double radius) {
    double weights[TAPS_MAX + 1], sum = 1.0, squares = 0.0;
    const size_t reach = spot_weights(radius, weights);
    for (size_t k = 1; k <= reach; k++) {
        sum += 2.0 * weights[k];
        squares += 2.0 * weights[k] * (double)(k * k);
    }
    return squares / sum;
}

double spot_radius(double spread) {
    double low = 0.05, high = TAPS_MAX / SPOT_REACH;
    if (spread < SPREAD_LEAST)
        return 0.0;
    for (int k = 0; k < BISECTIONS; k++) {
        const double middle = 0.5 * (low + high);
        *(weights_variance(middle) < spread ? &low : &high) = middle;
    }
    return 0.5 * (low + high);
}

/* Weighted mean over the neighbours of place `at` in a line of `length` values, `stride` apart. */
static double line_mean(const double *line, size_t length, size_t stride, size_t at, const double *weights,
                        size_t reach) {
    const size_t first = at > reach ? at - reach : 0, last = at + reach < length ? at + reach : length - 1;
    double sum = 0.0, total = 0.0;
    for (size_t k = first; k <= last; k++) {
        const double weight = weights[k > at ? k - at : at - k];
        sum += weight * line[k * stride];
        total += weight;
    }
    return sum / total;
}

static void average(size_t nx, size_t ny, const double *height, double spread, double *lines, double *mean) {
    double weights[TAPS_MAX + 1];
    if (spread < SPREAD_LEAST) {
        memcpy(mean, height, nx * ny * sizeof *mean);
        return;
    }
    const size_t reach = spot_weights(spot_radius(spread), weights);
    for (size_t i = 0; i < nx; i++)
        for (size_t j = 0; j < ny; j++)
            lines[i * ny + j] = line_mean(height + i * ny, ny, 1, j, weights, reach);
    for (size_t i = 0; i < nx; i++)
        for (size_t j = 0; j < ny; j++)
            mean[i * ny + j] = line_mean(lines + j, nx, ny, i, weights, reach);
}

/* The cell before a place on a line of `length` cells, and how far beyond it the place is. */
static size_t cell_before(double place, size_t length, double *beyond) {
    const double inside = within(place, 0.0, (double)length - 1.0);
    const size_t cell = (size_t)inside;
    *beyond = inside - (double)cell;
    return cell;
}

static void move(size_t nx, size_t ny, const double *height, double x, double y, double *moved) {
    for (size_t i = 0; i < nx; i++) {
        double right, up;
        const size_t row = cell_before((double)i + x, nx, &up), next_row = row + 1 < nx ? row + 1 : row;
        for (size_t j = 0; j < ny; j++) {
            const size_t column = cell_before((double)j + y, ny, &right), next = column + 1 < ny ? column + 1 : column;
            const double near = (1.0 - right) * height[row * ny + column] + right * height[row * ny + next];
            const double far = (1.0 - right) * height[next_row * ny + column] + right * height[next_row * ny + next];
            moved[i * ny + j] = (1.0 - up) * near + up * far;
        }
    }
}

void displaced_scan(size_t nx, size_t ny, const double *height, Displacement displacement, double *scratch,
                    double *reading) {
    average(nx, ny, height, displacement.spread, scratch, scratch + nx * ny);
    move(nx, ny, scratch + nx * ny, displacement.x, displacement.y, reading);
}

/* (more - less) / step in `less`. */
static void difference(size_t cells, const double *more, double step, double *less) {
    for (size_t cell = 0; cell < cells; cell++)
        less[cell] = (more[cell] - less[cell]) / step;
}

void displaced_scan_slopes(size_t nx, size_t ny, const double *height, Displacement displacement, double *scratch,
                           double *slopes) {
    const size_t cells = nx * ny;
    double *mean = scratch + cells, *more = scratch + 2 * cells;
    const double x = displacement.x, y = displacement.y, spread = displacement.spread;
    average(nx, ny, height, spread, scratch, mean);
    move(nx, ny, mean, x + SHIFT_STEP, y, more);
    move(nx, ny, mean, x - SHIFT_STEP, y, slopes);
    difference(cells, more, 2.0 * SHIFT_STEP, slopes);
    move(nx, ny, mean, x, y + SHIFT_STEP, more);
    move(nx, ny, mean, x, y - SHIFT_STEP, slopes + cells);
    difference(cells, more, 2.0 * SHIFT_STEP, slopes + cells);
    const Displacement less = {x, y, fmax(0.0, spread - SPREAD_STEP)}, wider = {x, y, spread + SPREAD_STEP};
    displaced_scan(nx, ny, height, less, scratch, slopes + 2 * cells);
    displaced_scan(nx, ny, height, wider, scratch, more);
    difference(cells, more, wider.spread - less.spread, slopes + 2 * cells);
}
