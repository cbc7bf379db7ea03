/* Readings of a scan: its datum (scan_datum.c), and readings of a map by a displaced sensor with a wide spot
 * (predicted_scan.c). */
#ifndef INKLOOP_SCAN_VIEW_H
#define INKLOOP_SCAN_VIEW_H

#include <string.h>

#include "surface_estimate.h"

static const double NU = 4.0; /* degrees of freedom of a reading's error (Lange, Little, Taylor 1989) */
/* errors of the view model: of the place [cells], and of the variance of the spot, as a share of it (assumed) */
static const double PLACE_ERROR = 0.004, SHAPE_ERROR = 0.03;
static const double NOISELESS = 1e-20; /* [m^2], the least variance of a reading: a tenth of a nanometre */

typedef struct {
    double term[DATUM_TERMS];                    /* coefficients of 1, u, w, u^2, u w, w^2 [m] */
    double precision[DATUM_TERMS * DATUM_TERMS]; /* inverse of their covariance */
    ReadingNoise noise;
} ScanDatum;

/* Variance of the rounding of readings that are all multiples of one step [m^2]; 0: there is no such step. layer:
 * height of a layer [m]. */
double rounding_variance(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double layer);

/* The datum at (u, w) [m]. */
static inline double datum_at(const double term[DATUM_TERMS], double u, double w) {
    return term[0] + u * (term[1] + u * term[3]) + w * (term[2] + u * term[4] + w * term[5]);
}

/* The terms 1, u, w, u^2, u w, w^2. */
static inline void datum_terms(double u, double w, double term[DATUM_TERMS]) {
    const double all[DATUM_TERMS] = {1.0, u, w, u * u, u * w, w * w};
    memcpy(term, all, sizeof all);
}

/* Coordinate of a row or column: -1 to 1 over the grid. */
static inline double place_on(size_t at, size_t count) {
    return count > 1 ? 2.0 * (double)at / ((double)count - 1.0) - 1.0 : 0.0;
}

/* Place of a reading: bilinear interpolation between four cells; beyond the border the map continues level. */
typedef struct {
    size_t cell, below, right; /* the first of the four, and steps to the next row and column */
    double x, y;               /* distance beyond the first one [cells] */
} Place;

static inline Place place_of(size_t nx, size_t ny, double x, double y) {
    const double last_x = (double)nx - 1.0, last_y = (double)ny - 1.0;
    const double inside_x = x > 0.0 ? (x < last_x ? x : last_x) : 0.0;
    const double inside_y = y > 0.0 ? (y < last_y ? y : last_y) : 0.0;
    const size_t last_row = nx > 1 ? nx - 2 : 0, last_column = ny > 1 ? ny - 2 : 0;
    const size_t row = (size_t)inside_x < last_row ? (size_t)inside_x : last_row;
    const size_t column = (size_t)inside_y < last_column ? (size_t)inside_y : last_column;
    return (Place){row * ny + column, nx > 1 ? ny : 0, ny > 1 ? 1 : 0, inside_x - (double)row,
                   inside_y - (double)column};
}

static inline double value_at(const double *map, const Place *place) {
    const double *first = map + place->cell, *second = first + place->below;
    const double near = first[0] + place->y * (first[place->right] - first[0]);
    const double far = second[0] + place->y * (second[place->right] - second[0]);
    return near + place->x * (far - near);
}

/* Place of the reading of a cell [cells]. */
typedef struct {
    double x, y;
} Spot;

static inline Spot spot_of(const double g[GEOMETRY], size_t nx, size_t ny, size_t i, size_t j) {
    const double u = place_on(i, nx), w = place_on(j, ny);
    return (Spot){(double)i + g[SHIFT_X] + g[ALONG_X_U] * u + g[ALONG_X_W] * w,
                  (double)j + g[SHIFT_Y] + g[ALONG_Y_U] * u + g[ALONG_Y_W] * w};
}

/* Derivatives of a reading: with respect to its place [m per cell], and to the variance of its spot [m per cells^2]. */
typedef struct {
    double along_x, along_y, with_spread;
} Slopes;

typedef struct {
    Spot spot;
    Place place;
    double value; /* [m] */
    Slopes slopes;
} Reading;

/* Half a step of the difference quotients [cells]. */
#define SLOPE_STEP 0.3

/* Reading of a map that is averaged over the spot, and its derivative with respect to the spot (average_prediction). */
static inline Reading reading_at(size_t nx, size_t ny, const double *averaged, const double *slope, Spot spot,
                                 double step) {
    const Place place = place_of(nx, ny, spot.x, spot.y);
    const Place up = place_of(nx, ny, spot.x - step, spot.y), left = place_of(nx, ny, spot.x, spot.y - step);
    const Place down = place_of(nx, ny, spot.x + step, spot.y), right = place_of(nx, ny, spot.x, spot.y + step);
    return (Reading){spot,
                     place,
                     value_at(averaged, &place),
                     {(value_at(averaged, &down) - value_at(averaged, &up)) / (2.0 * step),
                      (value_at(averaged, &right) - value_at(averaged, &left)) / (2.0 * step),
                      value_at(slope, &place)}};
}

/* Derivatives of a reading at (u, w) by the geometry. */
static inline void geometry_column(const Slopes *slopes, double u, double w, double column[GEOMETRY]) {
    const double x = slopes->along_x, y = slopes->along_y;
    memcpy(column, (double[GEOMETRY]){x, y, x * u, x * w, y * u, y * w, slopes->with_spread},
           GEOMETRY * sizeof *column);
}

/* Variance of a reading at (u, w) through the geometry [m^2]. */
double geometry_variance(const double *covariance, const Slopes *slopes, double u, double w);

/* The inverse geometry: place on the scan of each cell's reading. All 0 if there is none. */
void reversed(const double g[GEOMETRY], size_t nx, size_t ny, double back[GEOMETRY]);

#endif
