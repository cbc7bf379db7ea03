#include "displaced_scan.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "instruction_sets.h"

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

/* Weighted mean over the neighbours of a column that a row has. */
static INLINED double row_mean(const double *row, size_t ny, size_t j, const Spot *spot) {
    const size_t first = j > spot->reach ? j - spot->reach : 0, last = j + spot->reach < ny ? j + spot->reach : ny - 1;
    double sum = 0.0, total = 0.0;
    for (size_t k = first; k <= last; k++) {
        const double weight = spot->weights[k > j ? k - j : j - k];
        sum += weight * row[k];
        total += weight;
    }
    return sum / total;
}

/* The same for columns that have all their neighbours. */
static INLINED void inner_means(const double *row, const Spot *spot, size_t left, size_t right, double *restrict mean) {
    const size_t reach = spot->reach;
    double total = 0.0;
    for (size_t j = left; j < right; j++)
        mean[j] = 0.0;
    for (size_t tap = 0; tap <= 2 * reach; tap++) {
        const double weight = spot->weights[tap > reach ? tap - reach : reach - tap], *read = row + tap;
        for (size_t j = left; j < right; j++)
            mean[j] += weight * read[j - reach];
        total += weight;
    }
    for (size_t j = left; j < right; j++)
        mean[j] /= total;
}

/* Mean of the spot along a row. */
static INLINED void mean_of_row(const double *row, size_t ny, const Spot *spot, const Patch *patch, double *mean) {
    const size_t reach = spot->reach, last = ny > reach ? ny - reach : 0;
    const size_t from = patch->left > reach ? patch->left : reach, end = patch->right < last ? patch->right : last;
    for (size_t j = patch->left; j < patch->right; j++) {
        if (j == from && j < end) {
            inner_means(row, spot, from, end, mean);
            j = end - 1;
        } else
            mean[j] = row_mean(row, ny, j, spot);
    }
}

/* Mean of the spot over the rows about row i. */
static INLINED void mean_of_rows(Rows lines, size_t nx, size_t ny, size_t i, const Spot *spot, const Patch *patch,
                                 double *restrict mean) {
    const size_t first = i > spot->reach ? i - spot->reach : 0, last = i + spot->reach < nx ? i + spot->reach : nx - 1;
    double total = 0.0;
    for (size_t j = patch->left; j < patch->right; j++)
        mean[j] = 0.0;
    for (size_t k = first; k <= last; k++) {
        const double weight = spot->weights[k > i ? k - i : i - k], *line = row_of(lines, ny, k);
        for (size_t j = patch->left; j < patch->right; j++)
            mean[j] += weight * line[j];
        total += weight;
    }
    for (size_t j = patch->left; j < patch->right; j++)
        mean[j] /= total;
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

static INLINED void copy_patch(size_t ny, const double *map, const Patch *patch, Rows copy) {
    for (size_t i = patch->top; i < patch->bottom; i++)
        memcpy(row_of(copy, ny, i) + patch->left, map + i * ny + patch->left,
               (patch->right - patch->left) * sizeof *map);
}

/* The mean of the spot on the cells of `patch`, from `height`; what stands in `lines` and `mean` elsewhere is of no
 * account. */
static INLINED void average(size_t nx, size_t ny, const double *height, const Spot *spot, const Patch *patch,
                            Rows lines, Rows mean) {
    if (spot->reach == 0) {
        copy_patch(ny, height, patch, mean);
        return;
    }
    const Patch read = patch_widened(patch, nx, ny, spot->reach);
    for (size_t i = read.top; i < read.bottom; i++)
        mean_of_row(height + i * ny, ny, spot, patch, row_of(lines, ny, i));
    for (size_t i = patch->top; i < patch->bottom; i++)
        mean_of_rows(lines, nx, ny, i, spot, patch, row_of(mean, ny, i));
}

/* The cell before a place on a line of `length` cells, and how far beyond it the place is. */
static INLINED size_t cell_before(double place, size_t length, double *beyond) {
    const double inside = within(place, 0.0, (double)length - 1.0);
    const size_t cell = (size_t)inside;
    *beyond = inside - (double)cell;
    return cell;
}

enum { COLUMNS = 64 }; /* that are moved together */

/* Where some columns are read: by straight lines between a cell and the next one on the grid. */
typedef struct {
    size_t cell[COLUMNS], next[COLUMNS];
    double beyond[COLUMNS]; /* the former */
    size_t from, end;       /* of those that are read as many columns further as the one in the middle */
} MovedColumns;

static INLINED void moved_columns(size_t ny, double y, size_t left, size_t count, MovedColumns *columns) {
    const size_t middle = count / 2;
    for (size_t k = 0; k < count; k++) {
        columns->cell[k] = cell_before((double)(left + k) + y, ny, &columns->beyond[k]);
        columns->next[k] = columns->cell[k] + 1 < ny ? columns->cell[k] + 1 : columns->cell[k];
    }
    const size_t ahead = columns->cell[middle] - middle; /* of the first one, beyond any number if it lies behind */
    columns->from = columns->end = middle;
    while (columns->from > 0 && columns->cell[columns->from - 1] == columns->from - 1 + ahead)
        columns->from--;
    while (columns->end < count && columns->cell[columns->end] == columns->end + ahead &&
           columns->next[columns->end] > columns->cell[columns->end])
        columns->end++;
}

/* Those at the ends, where the grid may go no further. */
static INLINED void move_outer(const MovedColumns *columns, size_t from, size_t end, const double *here,
                               const double *there, double up, double *moved) {
    for (size_t k = from; k < end; k++) {
        const size_t cell = columns->cell[k], next = columns->next[k];
        const double right = columns->beyond[k];
        const double near = (1.0 - right) * here[cell] + right * here[next];
        const double far = (1.0 - right) * there[cell] + right * there[next];
        moved[k] = (1.0 - up) * near + up * far;
    }
}

/* The others, next to each other. */
static INLINED void move_inner(const MovedColumns *columns, const double *here, const double *there, double up,
                               double *restrict moved) {
    const size_t from = columns->from, cell = columns->cell[from];
    for (size_t k = from; k < columns->end; k++) {
        const double right = columns->beyond[k];
        const double near = (1.0 - right) * here[cell + k - from] + right * here[cell + k - from + 1];
        const double far = (1.0 - right) * there[cell + k - from] + right * there[cell + k - from + 1];
        moved[k] = (1.0 - up) * near + up * far;
    }
}

static INLINED void move(size_t nx, size_t ny, Rows height, double x, double y, const Patch *patch, Rows moved) {
    MovedColumns columns;
    for (size_t left = patch->left; left < patch->right; left += COLUMNS) {
        const size_t count = patch->right - left < COLUMNS ? patch->right - left : COLUMNS;
        moved_columns(ny, y, left, count, &columns);
        for (size_t i = patch->top; i < patch->bottom; i++) {
            double up;
            const size_t row = cell_before((double)i + x, nx, &up), next = row + 1 < nx ? row + 1 : row;
            const double *here = row_of(height, ny, row), *there = row_of(height, ny, next);
            double *its = row_of(moved, ny, i) + left;
            move_outer(&columns, 0, columns.from, here, there, up, its);
            move_inner(&columns, here, there, up, its);
            move_outer(&columns, columns.end, count, here, there, up, its);
        }
    }
}

/* What a move by less than a cell and the step of the difference quotients reads. */
static INLINED Patch patch_moved(const Patch *patch, size_t nx, size_t ny, double x, double y) {
    const double further = fmax(fabs(x), fabs(y)) + SHIFT_STEP;
    return patch_widened(patch, nx, ny, (size_t)ceil(further));
}

static INLINED void scan_with(size_t nx, size_t ny, const double *height, const Spot *spot, double x, double y,
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

/* (more - less) / step in `less`. */
static INLINED void difference(size_t ny, Rows more, double step, const Patch *patch, Rows less) {
    for (size_t i = patch->top; i < patch->bottom; i++) {
        const double *high = row_of(more, ny, i);
        double *low = row_of(less, ny, i);
        for (size_t j = patch->left; j < patch->right; j++)
            low[j] = (high[j] - low[j]) / step;
    }
}

/* The slopes with the shift where the scan is not displaced: the difference quotients are those of a cell's neighbours.
 */
static INLINED void slopes_between(size_t nx, size_t ny, Rows mean, const Patch *patch, Rows along_x, Rows along_y) {
    for (size_t i = patch->top; i < patch->bottom; i++) {
        const double *here = row_of(mean, ny, i), *above = i > 0 ? here - ny : here;
        const double *below = i + 1 < nx ? here + ny : here;
        double *restrict down = row_of(along_x, ny, i), *restrict right = row_of(along_y, ny, i);
        const size_t from = patch->left > 0 ? patch->left : 1, end = patch->right < ny ? patch->right : ny - 1;
        for (size_t j = patch->left; j < patch->right; j++)
            down[j] = 0.5 * (below[j] - above[j]);
        for (size_t j = from; j < end; j++)
            right[j] = 0.5 * (here[j + 1] - here[j - 1]);
        if (patch->left == 0)
            right[0] = 0.5 * (here[ny > 1 ? 1 : 0] - here[0]);
        if (patch->right == ny && ny > 1)
            right[ny - 1] = 0.5 * (here[ny - 1] - here[ny - 2]);
    }
}

/* The slopes with the shift from differences of displaced scans. */
static INLINED void slopes_apart(size_t nx, size_t ny, Rows mean, double x, double y, const Patch *patch, Rows more,
                                 Rows along_x, Rows along_y) {
    move(nx, ny, mean, x + SHIFT_STEP, y, patch, more);
    move(nx, ny, mean, x - SHIFT_STEP, y, patch, along_x);
    difference(ny, more, 2.0 * SHIFT_STEP, patch, along_x);
    move(nx, ny, mean, x, y + SHIFT_STEP, patch, more);
    move(nx, ny, mean, x, y - SHIFT_STEP, patch, along_y);
    difference(ny, more, 2.0 * SHIFT_STEP, patch, along_y);
}

/* What is scanned, and how: for both functions, and for their clones. */
typedef struct {
    size_t nx, ny;
    const double *height;
    const DisplacedView *view;
    const Patch *patch;
    const Scratch *scratch;
} DisplacedScan;

static INLINED void take_reading(const DisplacedScan *scan, const Rows *reading) {
    const Displacement by = scan->view->displacement;
    scan_with(scan->nx, scan->ny, scan->height, &scan->view->spot, by.x, by.y, scan->patch, scan->scratch, *reading);
}

static INLINED void take_slopes(const DisplacedScan *scan, const Rows slopes[3]) {
    const size_t nx = scan->nx, ny = scan->ny;
    const Patch *patch = scan->patch;
    const Scratch *scratch = scan->scratch;
    const Rows mean = scratch_map(scratch, ny, 1), more = scratch_map(scratch, ny, 2);
    const double x = scan->view->displacement.x, y = scan->view->displacement.y;
    const Patch read = patch_moved(patch, nx, ny, x, y);
    average(nx, ny, scan->height, &scan->view->spot, &read, scratch_map(scratch, ny, 0), mean);
    if (x == 0.0 && y == 0.0)
        slopes_between(nx, ny, mean, patch, slopes[0], slopes[1]);
    else
        slopes_apart(nx, ny, mean, x, y, patch, more, slopes[0], slopes[1]);
    scan_with(nx, ny, scan->height, &scan->view->less, x, y, patch, scratch, slopes[2]);
    scan_with(nx, ny, scan->height, &scan->view->wider, x, y, patch, scratch, more);
    difference(ny, more, scan->view->step, patch, slopes[2]);
}

static INLINED void take(const DisplacedScan *scan, const Rows *maps, bool with_slopes) {
    if (with_slopes)
        take_slopes(scan, maps);
    else
        take_reading(scan, maps);
}

static void take_plain(const DisplacedScan *scan, const Rows *maps, bool with_slopes) {
    take(scan, maps, with_slopes);
}

static WITH_AVX2 void take_avx2(const DisplacedScan *scan, const Rows *maps, bool with_slopes) {
    take(scan, maps, with_slopes);
}

void displaced_scan(size_t nx, size_t ny, const double *height, const DisplacedView *view, const Patch *patch,
                    const Scratch *scratch, Rows reading) {
    const DisplacedScan scan = {nx, ny, height, view, patch, scratch};
    (HAS_AVX2 ? take_avx2 : take_plain)(&scan, &reading, false);
}

void displaced_scan_slopes(size_t nx, size_t ny, const double *height, const DisplacedView *view, const Patch *patch,
                           const Scratch *scratch, const Rows slopes[3]) {
    const DisplacedScan scan = {nx, ny, height, view, patch, scratch};
    (HAS_AVX2 ? take_avx2 : take_plain)(&scan, slopes, true);
}
