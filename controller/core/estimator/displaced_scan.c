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

static void copy_patch(size_t ny, const double *map, const Patch *patch, Rows copy) {
    for (size_t i = patch->top; i < patch->bottom; i++)
        memcpy(row_of(copy, ny, i) + patch->left, map + i * ny + patch->left,
               (patch->right - patch->left) * sizeof *map);
}

/* The mean of the spot on the cells of `patch`, from `height`; what stands in `lines` and `mean` elsewhere is of no
 * account. */
static void average(size_t nx, size_t ny, const double *height, const Spot *spot, const Patch *patch, Rows lines,
                    Rows mean) {
    if (spot->reach == 0) {
        copy_patch(ny, height, patch, mean);
        return;
    }
    const Patch read = patch_widened(patch, nx, ny, spot->reach);
    for (size_t i = read.top; i < read.bottom; i++)
        for (size_t j = patch->left; j < patch->right; j++)
            row_of(lines, ny, i)[j] = line_mean(height + i * ny, ny, 1, j, spot->weights, spot->reach);
    for (size_t i = patch->top; i < patch->bottom; i++)
        for (size_t j = patch->left; j < patch->right; j++)
            row_of(mean, ny, i)[j] =
                line_mean(lines.values + j, nx - lines.top, ny, i - lines.top, spot->weights, spot->reach);
}

/* The cell before a place on a line of `length` cells, and how far beyond it the place is. */
static size_t cell_before(double place, size_t length, double *beyond) {
    const double inside = within(place, 0.0, (double)length - 1.0);
    const size_t cell = (size_t)inside;
    *beyond = inside - (double)cell;
    return cell;
}

static void move(size_t nx, size_t ny, Rows height, double x, double y, const Patch *patch, Rows moved) {
    for (size_t i = patch->top; i < patch->bottom; i++) {
        double right, up, *row_moved = row_of(moved, ny, i);
        const size_t row = cell_before((double)i + x, nx, &up), next_row = row + 1 < nx ? row + 1 : row;
        const double *here = row_of(height, ny, row), *there = row_of(height, ny, next_row);
        for (size_t j = patch->left; j < patch->right; j++) {
            const size_t column = cell_before((double)j + y, ny, &right), next = column + 1 < ny ? column + 1 : column;
            const double near = (1.0 - right) * here[column] + right * here[next];
            const double far = (1.0 - right) * there[column] + right * there[next];
            row_moved[j] = (1.0 - up) * near + up * far;
        }
    }
}

/* What a move by less than a cell and the step of the difference quotients reads. */
static Patch patch_moved(const Patch *patch, size_t nx, size_t ny, double x, double y) {
    const double further = fmax(fabs(x), fabs(y)) + SHIFT_STEP;
    return patch_widened(patch, nx, ny, (size_t)ceil(further));
}

static void scan_with(size_t nx, size_t ny, const double *height, const Spot *spot, double x, double y,
                      const Patch *patch, const Scratch *scratch, Rows reading) {
    const Patch read = patch_moved(patch, nx, ny, x, y);
    const Rows lines = scratch_map(scratch, ny, 0), mean = scratch_map(scratch, ny, 1);
    if (x == 0.0 && y == 0.0) {
        average(nx, ny, height, spot, patch, lines, reading);
        return;
    }
    average(nx, ny, height, spot, &read, lines, mean);
    move(nx, ny, mean, x, y, patch, reading);
}

void displaced_scan(size_t nx, size_t ny, const double *height, const DisplacedView *view, const Patch *patch,
                    const Scratch *scratch, Rows reading) {
    scan_with(nx, ny, height, &view->spot, view->displacement.x, view->displacement.y, patch, scratch, reading);
}

/* (more - less) / step in `less`. */
static void difference(size_t ny, Rows more, double step, const Patch *patch, Rows less) {
    for (size_t i = patch->top; i < patch->bottom; i++) {
        const double *high = row_of(more, ny, i);
        double *low = row_of(less, ny, i);
        for (size_t j = patch->left; j < patch->right; j++)
            low[j] = (high[j] - low[j]) / step;
    }
}

void displaced_scan_slopes(size_t nx, size_t ny, const double *height, const DisplacedView *view, const Patch *patch,
                           const Scratch *scratch, const Rows slopes[3]) {
    const Rows mean = scratch_map(scratch, ny, 1), more = scratch_map(scratch, ny, 2);
    const double x = view->displacement.x, y = view->displacement.y;
    const Patch read = patch_moved(patch, nx, ny, x, y);
    average(nx, ny, height, &view->spot, &read, scratch_map(scratch, ny, 0), mean);
    move(nx, ny, mean, x + SHIFT_STEP, y, patch, more);
    move(nx, ny, mean, x - SHIFT_STEP, y, patch, slopes[0]);
    difference(ny, more, 2.0 * SHIFT_STEP, patch, slopes[0]);
    move(nx, ny, mean, x, y + SHIFT_STEP, patch, more);
    move(nx, ny, mean, x, y - SHIFT_STEP, patch, slopes[1]);
    difference(ny, more, 2.0 * SHIFT_STEP, patch, slopes[1]);
    scan_with(nx, ny, height, &view->less, x, y, patch, scratch, slopes[2]);
    scan_with(nx, ny, height, &view->wider, x, y, patch, scratch, more);
    difference(ny, more, view->step, patch, slopes[2]);
}
