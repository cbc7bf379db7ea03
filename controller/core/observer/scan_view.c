#include "scan_view.h"

#include <math.h>
#include <string.h>

#include "instruction_sets.h"

static const double POINT = 1e-9;      /* variance below which a spot is a point [cells^2] */
static const double NARROW = 0.36;     /* variance up to which a spot covers adjacent cells only [cells^2] */
static const double SPREAD_STEP = 0.1; /* step of a difference quotient [cells^2] */
/* reach of a spot in standard deviations: less than a ten-thousandth lies beyond */
static const double BORDER = 4.0;
enum { TAPS_MAX = 5 }; /* taps of a spot to each side */

/* Weights of the cells at distance 0, 1, ...; their variance is that of the spot. Returns the largest distance. */
static size_t spot_weights(double spread, double weights[TAPS_MAX + 1]) {
    double sum = 1.0;
    if (spread < NARROW) {
        weights[0] = 1.0 - spread;
        weights[1] = 0.5 * spread;
        return 1;
    }
    for (size_t k = 0; k <= TAPS_MAX; k++)
        weights[k] = exp(-0.5 * (double)(k * k) / spread);
    for (size_t k = 1; k <= TAPS_MAX; k++)
        sum += 2.0 * weights[k];
    for (size_t k = 0; k <= TAPS_MAX; k++)
        weights[k] /= sum;
    return TAPS_MAX;
}

static INLINED size_t clamped(size_t at, size_t away, bool is_before, size_t count) {
    if (is_before)
        return at > away ? at - away : 0;
    return at + away < count ? at + away : count - 1;
}

static void average_rows(size_t nx, size_t ny, const double *map, size_t reach, const double *weights, double *mean) {
    for (size_t i = 0; i < nx; i++) {
        const double *row = map + i * ny;
        double *restrict into = mean + i * ny;
        for (size_t j = 0; j < ny; j++) {
            double sum = weights[0] * row[j];
            for (size_t k = 1; k <= reach; k++)
                sum += weights[k] * (row[clamped(j, k, true, ny)] + row[clamped(j, k, false, ny)]);
            into[j] = sum;
        }
    }
}

static void average_columns(size_t nx, size_t ny, const double *map, size_t reach, const double *weights,
                            double *mean) {
    for (size_t i = 0; i < nx; i++) {
        double *restrict into = mean + i * ny;
        for (size_t j = 0; j < ny; j++)
            into[j] = weights[0] * map[i * ny + j];
        for (size_t k = 1; k <= reach; k++) {
            const double *up = map + clamped(i, k, true, nx) * ny, *down = map + clamped(i, k, false, nx) * ny;
            for (size_t j = 0; j < ny; j++)
                into[j] += weights[k] * (up[j] + down[j]);
        }
    }
}

static void means_over_spot(size_t nx, size_t ny, const double *map, double spread, double *lines, double *averaged) {
    double weights[TAPS_MAX + 1];
    if (spread < POINT) {
        memcpy(averaged, map, nx * ny * sizeof *map);
        return;
    }
    const size_t reach = spot_weights(spread, weights);
    average_rows(nx, ny, map, reach, weights, lines);
    average_columns(nx, ny, lines, reach, weights, averaged);
}

void average_under_spot(size_t nx, size_t ny, const double *map, double spread, double *lines, double *averaged,
                        double *slope) {
    means_over_spot(nx, ny, map, spread, lines, averaged);
    means_over_spot(nx, ny, map, fmax(spread, 0.0) + SPREAD_STEP, lines, slope);
    for (size_t cell = 0; cell < nx * ny; cell++)
        slope[cell] = (slope[cell] - averaged[cell]) / SPREAD_STEP;
}

double geometry_variance(const double *covariance, const Slopes *slopes, double u, double w) {
    double column[GEOMETRY], sum = 0.0;
    geometry_column(slopes, u, w, column);
    for (size_t a = 0; a < GEOMETRY; a++) {
        double line = 0.5 * covariance[a * GEOMETRY + a] * column[a];
        for (size_t b = 0; b < a; b++)
            line += covariance[a * GEOMETRY + b] * column[b];
        sum += 2.0 * line * column[a];
    }
    return sum;
}

double border_variance(size_t nx, size_t ny, const double *map, const Reading *reading, double spread) {
    if (spread < POINT)
        return 0.0;
    const Spot *spot = &reading->spot;
    const double to[4] = {spot->x, (double)nx - 1.0 - spot->x, spot->y, (double)ny - 1.0 - spot->y};
    double sum = 0.0;
    for (size_t side = 0; side < 4; side++) {
        if (!(to[side] < BORDER * sqrt(spread)))
            continue;
        const double x[4] = {0.0, (double)nx, spot->x, spot->x}, y[4] = {spot->y, spot->y, 0.0, (double)ny};
        const Place border = place_of(nx, ny, x[side], y[side]);
        /* share of the spot beyond the border */
        const double share = 0.5 * erfc((fmax(to[side], 0.0) + 0.5) / sqrt(2.0 * spread));
        const double off = share / (1.0 - share) * (reading->value - value_at(map, &border));
        sum += off * off;
    }
    return sum;
}

void reversed(const double g[GEOMETRY], size_t nx, size_t ny, double back[GEOMETRY]) {
    const double rise = half_of(nx), run = half_of(ny);
    const double a = 1.0 + g[ALONG_X_U] / rise, b = g[ALONG_X_W] / run, c = g[ALONG_Y_U] / rise,
                 d = 1.0 + g[ALONG_Y_W] / run, determinant = a * d - b * c;
    memset(back, 0, GEOMETRY * sizeof *back);
    if (!(fabs(determinant) > 0.1))
        return;
    const double inverse[4] = {d / determinant, -b / determinant, -c / determinant, a / determinant};
    back[SHIFT_X] = -(inverse[0] * g[SHIFT_X] + inverse[1] * g[SHIFT_Y]);
    back[SHIFT_Y] = -(inverse[2] * g[SHIFT_X] + inverse[3] * g[SHIFT_Y]);
    back[ALONG_X_U] = (inverse[0] - 1.0) * rise;
    back[ALONG_X_W] = inverse[1] * run;
    back[ALONG_Y_U] = inverse[2] * rise;
    back[ALONG_Y_W] = (inverse[3] - 1.0) * run;
}

void read_map(const Registration *registration, size_t nx, size_t ny, const double *map, double *lines,
              double *averaged, double *reading) {
    const double *g = registration->estimate;
    if (!registration->is_displaced) {
        memcpy(reading, map, nx * ny * sizeof *map);
        return;
    }
    means_over_spot(nx, ny, map, g[SPREAD], lines, averaged);
    for (size_t i = 0; i < nx; i++)
        for (size_t j = 0; j < ny; j++) {
            const Spot spot = spot_of(g, (double)i, (double)j, place_on(i, nx), place_on(j, ny));
            const Place place = place_of(nx, ny, spot.x, spot.y);
            reading[i * ny + j] = value_at(averaged, &place);
        }
}
