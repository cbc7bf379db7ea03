#include "fine_surface.h"

size_t rim_points(const FineSurface *s) {
    return WIDEST_SPREAD * s->per_pitch + 2; /* 2: interpolation needs surrounding points */
}

size_t column_count(const FineSurface *s) {
    return s->nx * s->per_pitch + 2 * rim_points(s);
}

size_t row_count(const FineSurface *s) {
    return s->ny * s->per_pitch + 2 * rim_points(s);
}

double height_at(const FineSurface *s, double x, double y) {
    const size_t i = (size_t)x, j = (size_t)y, rows = row_count(s);
    const double right = x - (double)i, up = y - (double)j;
    const double *left_side = s->height + i * rows + j, *right_side = left_side + rows;
    const double lower = left_side[0] + right * (right_side[0] - left_side[0]);
    const double upper = left_side[1] + right * (right_side[1] - left_side[1]);
    return lower + up * (upper - lower);
}

/* Heights between the centres of the cells, bilinear; level beyond the outermost centres. */
static double between_cells(const FineSurface *s, const double *cells, size_t i, size_t j) {
    const size_t point[2] = {i, j}, count[2] = {s->nx, s->ny};
    size_t low[2], high[2];
    double share[2];
    for (int axis = 0; axis < 2; axis++) {
        const double last = (double)count[axis] - 1.0;
        double place = ((double)point[axis] - (double)rim_points(s) + 0.5) / (double)s->per_pitch - 0.5;
        place = place < 0.0 ? 0.0 : place > last ? last : place;
        low[axis] = (size_t)place;
        high[axis] = low[axis] + 1 < count[axis] ? low[axis] + 1 : low[axis];
        share[axis] = place - (double)low[axis];
    }
    const double *left = cells + low[0] * s->ny, *right = cells + high[0] * s->ny;
    const double lower = left[low[1]] + share[0] * (right[low[1]] - left[low[1]]);
    const double upper = left[high[1]] + share[0] * (right[high[1]] - left[high[1]]);
    return lower + share[1] * (upper - lower);
}

static double *first_point(const FineSurface *s, size_t cell_i, size_t cell_j) {
    return s->height + (rim_points(s) + cell_i * s->per_pitch) * row_count(s) + rim_points(s) + cell_j * s->per_pitch;
}

static double mean_cell(const FineSurface *s, size_t cell_i, size_t cell_j) {
    const double *first = first_point(s, cell_i, cell_j);
    double sum = 0.0;
    for (size_t a = 0; a < s->per_pitch; a++)
        for (size_t b = 0; b < s->per_pitch; b++)
            sum += first[a * row_count(s) + b];
    return sum / (double)(s->per_pitch * s->per_pitch);
}

/* Distance of a cell's point from the nearer border of the cell, in points. */
static double from_border(size_t point, size_t per_pitch) {
    const size_t other = per_pitch - 1 - point;
    return (double)(point < other ? point : other) + 0.5;
}

/* Raises one cell's mean by `rise`, in a tent that leaves its neighbours as they are. */
static void raise_cell(const FineSurface *s, size_t cell_i, size_t cell_j, double rise) {
    double *first = first_point(s, cell_i, cell_j);
    double sum = 0.0;
    for (size_t a = 0; a < s->per_pitch; a++)
        sum += from_border(a, s->per_pitch);
    const double top = rise * (double)(s->per_pitch * s->per_pitch) / (sum * sum);
    for (size_t a = 0; a < s->per_pitch; a++)
        for (size_t b = 0; b < s->per_pitch; b++)
            first[a * row_count(s) + b] += top * from_border(a, s->per_pitch) * from_border(b, s->per_pitch);
}

void spread_cells(const FineSurface *s, const double *cells) {
    for (size_t i = 0; i < column_count(s); i++)
        for (size_t j = 0; j < row_count(s); j++)
            s->height[i * row_count(s) + j] = between_cells(s, cells, i, j);
    for (size_t i = 0; i < s->nx; i++)
        for (size_t j = 0; j < s->ny; j++)
            raise_cell(s, i, j, cells[i * s->ny + j] - mean_cell(s, i, j));
}

void mean_cells(const FineSurface *s, double *cells) {
    for (size_t i = 0; i < s->nx; i++)
        for (size_t j = 0; j < s->ny; j++)
            cells[i * s->ny + j] = mean_cell(s, i, j);
}
