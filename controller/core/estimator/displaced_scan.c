#include "displaced_scan.h"

#include <math.h>
#include <string.h>

static const double SPOT_REACH = 4.0;    /* standard deviations; 6e-5 of the weight lies beyond */
static const double SHIFT_STEP = 0.02;   /* of the difference quotients [cells]: centred, so that a kink is halved */
static const double SPREAD_STEP = 0.02;  /* ... [cells^2] */
static const double SPREAD_LEAST = 1e-9; /* [cells^2] below which a spot is a point */
enum { BISECTIONS = 48 };                /* of a radius: to the last digit that matters */

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

static Spot spot_of(double spread) {
    Spot spot = {.reach = 0};
    if (spread >= SPREAD_LEAST)
        spot.reach = spot_weights(spot_radius(spread), spot.weights);
    return spot;
}

DisplacedView displaced_view(Displacement displacement) {
    const double less = fmax(0.0, displacement.spread - SPREAD_STEP), wider = displacement.spread + SPREAD_STEP;
    return (DisplacedView){displacement, spot_of(displacement.spread), spot_of(less), spot_of(wider), wider - less};
}

static void copy_patch(size_t ny, const double *map, const Patch *patch, double *copy) {
    for (size_t i = patch->top; i < patch->bottom; i++)
        memcpy(copy + i * ny + patch->left, map + i * ny + patch->left, (patch->right - patch->left) * sizeof *copy);
}

/* The mean of the spot on the cells of `patch`, from `height`; what stands in `lines` and `mean` elsewhere is of no
 * account. */
static void average(size_t nx, size_t ny, const double *height, const Spot *spot, const Patch *patch, double *lines,
                    double *mean) {
    if (spot->reach == 0) {
        copy_patch(ny, height, patch, mean);
        return;
    }
    const Patch read = patch_widened(patch, nx, ny, spot->reach);
    for (size_t i = read.top; i < read.bottom; i++)
        for (size_t j = patch->left; j < patch->right; j++)
            lines[i * ny + j] = line_mean(height + i * ny, ny, 1, j, spot->weights, spot->reach);
    for (size_t i = patch->top; i < patch->bottom; i++)
        for (size_t j = patch->left; j < patch->right; j++)
            mean[i * ny + j] = line_mean(lines + j, nx, ny, i, spot->weights, spot->reach);
}

/* The cell before a place on a line of `length` cells, and how far beyond it the place is. */
static size_t cell_before(double place, size_t length, double *beyond) {
    const double inside = within(place, 0.0, (double)length - 1.0);
    const size_t cell = (size_t)inside;
    *beyond = inside - (double)cell;
    return cell;
}

static void move(size_t nx, size_t ny, const double *height, double x, double y, const Patch *patch, double *moved) {
    for (size_t i = patch->top; i < patch->bottom; i++) {
        double right, up;
        const size_t row = cell_before((double)i + x, nx, &up), next_row = row + 1 < nx ? row + 1 : row;
        for (size_t j = patch->left; j < patch->right; j++) {
            const size_t column = cell_before((double)j + y, ny, &right), next = column + 1 < ny ? column + 1 : column;
            const double near = (1.0 - right) * height[row * ny + column] + right * height[row * ny + next];
            const double far = (1.0 - right) * height[next_row * ny + column] + right * height[next_row * ny + next];
            moved[i * ny + j] = (1.0 - up) * near + up * far;
        }
    }
}

/* What a move by less than a cell and the step of the difference quotients reads. */
static Patch patch_moved(const Patch *patch, size_t nx, size_t ny, double x, double y) {
    const double further = fmax(fabs(x), fabs(y)) + SHIFT_STEP;
    return patch_widened(patch, nx, ny, (size_t)ceil(further));
}

static void scan_with(size_t nx, size_t ny, const double *height, const Spot *spot, double x, double y,
                      const Patch *patch, double *scratch, double *reading) {
    const Patch read = patch_moved(patch, nx, ny, x, y);
    if (x == 0.0 && y == 0.0) {
        average(nx, ny, height, spot, patch, scratch, reading);
        return;
    }
    average(nx, ny, height, spot, &read, scratch, scratch + nx * ny);
    move(nx, ny, scratch + nx * ny, x, y, patch, reading);
}

void displaced_scan(size_t nx, size_t ny, const double *height, const DisplacedView *view, const Patch *patch,
                    double *scratch, double *reading) {
    scan_with(nx, ny, height, &view->spot, view->displacement.x, view->displacement.y, patch, scratch, reading);
}

/* (more - less) / step in `less`. */
static void difference(size_t ny, const double *more, double step, const Patch *patch, double *less) {
    for (size_t i = patch->top; i < patch->bottom; i++)
        for (size_t cell = i * ny + patch->left; cell < i * ny + patch->right; cell++)
            less[cell] = (more[cell] - less[cell]) / step;
}

void displaced_scan_slopes(size_t nx, size_t ny, const double *height, const DisplacedView *view, const Patch *patch,
                           double *scratch, double *slopes) {
    const size_t cells = nx * ny;
    double *mean = scratch + cells, *more = scratch + 2 * cells;
    const double x = view->displacement.x, y = view->displacement.y;
    const Patch read = patch_moved(patch, nx, ny, x, y);
    average(nx, ny, height, &view->spot, &read, scratch, mean);
    move(nx, ny, mean, x + SHIFT_STEP, y, patch, more);
    move(nx, ny, mean, x - SHIFT_STEP, y, patch, slopes);
    difference(ny, more, 2.0 * SHIFT_STEP, patch, slopes);
    move(nx, ny, mean, x, y + SHIFT_STEP, patch, more);
    move(nx, ny, mean, x, y - SHIFT_STEP, patch, slopes + cells);
    difference(ny, more, 2.0 * SHIFT_STEP, patch, slopes + cells);
    scan_with(nx, ny, height, &view->less, x, y, patch, scratch, slopes + 2 * cells);
    scan_with(nx, ny, height, &view->wider, x, y, patch, scratch, more);
    difference(ny, more, view->step, patch, slopes + 2 * cells);
}
