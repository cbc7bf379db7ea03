/* A scan as a linear function of the displacement of the sensor's frame and of the growth, about what is expected.
 *
 * Cells about which the surface is curved beyond its noise are walls: there a displacement shows. */
#ifndef INKLOOP_SCAN_LINEARISATION_H
#define INKLOOP_SCAN_LINEARISATION_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "displaced_scan.h"
#include "prediction_variance.h"
#include "row_ranges.h"

enum { SHIFT_X, SHIFT_Y, SPREAD, DISPLACEMENTS };

/* What is known of a surface before a scan; maps of nx * ny cells in C order. */
typedef struct {
    size_t nx, ny;
    const double *before, *predicted; /* heights before the layer and after it [m] */
    PredictionVariance variance;      /* of the prediction */
    const double *response;           /* DISPLACEMENTS maps [m per unit of the estimate] */
    const double *scan;               /* [m] */
    const uint8_t *valid;
    const uint8_t *reached; /* cells that droplets fall on, and their neighbours: 1 or 0 */
    double noise_variance;  /* of a reading [m^2] */
    double unsure;          /* error of a growth from which on it shows neither ink nor dead cells [m] */
    bool is_first_layer;    /* the ink is not known yet */
    bool is_unknown;        /* it is not known how much of the layer was jetted: nothing is learnt */
} ScanEvidence;

/* Unknowns of a scan: displacement before, step of the shift since, growth beyond the predicted one. */
enum { STEP = DISPLACEMENTS, SHIFTS = 2, GROWTH = STEP + SHIFTS, UNKNOWNS };

#define READING_STD 2e-8 /* least error of a reading at a wall [m] (assumed) */

enum { BLOCK = 64 }; /* cells that are looked at together, so that what is calculated of them stays in the cache */

/* Rows whose columns are taken together while the scan is not displaced, and those that they are taken from. */
enum { STRIP_ROWS = 8, STRIP_REACH = 2, STRIP = STRIP_ROWS + 2 * STRIP_REACH };

/* What only a registration that moves the scan needs, and a scan that is corrected; NULL before. */
typedef struct {
    double *surface, *growth, *displaced_growth;
    double *columns[GROWTH];
    double *scratch;                 /* SCRATCH_MAPS maps */
    double *before, *scan, *misread; /* the latter: variance of a reading beyond its noise [m^2] */
    uint8_t *seen, *clear;
    void *memory;
} MovedMaps;

/* How readings go with the unknowns but the growth, known at walls: elsewhere with the displacement as the heights do,
 * with the step of the shift not at all. */
typedef struct {
    const uint8_t *is_wall; /* cells that a displacement moves beyond their noise: 1 or 0 */
    double *of[GROWTH];
    bool is_packed;            /* the values of walls alone stand one after the other; else in maps */
    size_t before[CHUNKS + 1]; /* number of walls before the rows of each chunk */
} WallColumns;

/* Where the values of a cell are; `wall`: number of walls before it, carried to the next cell. */
static inline size_t column_place(const WallColumns *columns, size_t cell, size_t *wall) {
    const size_t place = columns->is_packed ? *wall : cell;
    *wall += columns->is_wall[cell];
    return place;
}

enum { ROOM_MAPS = 3 }; /* weight, rest, curvature */
enum { STRIP_MAPS = SCRATCH_MAPS + GROWTH };

/* Maps of one registration, of the caller but for the columns and the moved ones. */
typedef struct {
    WallColumns columns;
    double *weight, *rest, *curvature;
    uint8_t *is_wall;
    double *strips;        /* for each thread STRIP_MAPS times STRIP rows */
    double *packed;        /* memory of the columns of walls */
    const double *surface; /* that the scan is linearised about */
    bool is_moved;         /* ... and whether displaced: else the growth goes into the readings as it is */
    size_t threads;        /* the bits do not depend on it */
    MovedMaps moved;
} Room;

/* Takes the memory of the moved maps, if it is not there. False if there is none. */
bool open_moved(Room *room, size_t cells);
void close_room(Room *room);

/* Size of the second differences at the cells of row i [m]. */
static INLINED void curvature_of_row(size_t nx, size_t ny, const double *height, size_t i, double *restrict curvature) {
    const double *here = height + i * ny, *above = i > 0 ? here - ny : here, *below = i + 1 < nx ? here + ny : here;
    for (size_t j = 0; j < ny; j += ny > 1 ? ny - 1 : 1) { /* the ends of the row */
        const double left = here[j > 0 ? j - 1 : j], right = here[j + 1 < ny ? j + 1 : j];
        const double along_x = above[j] + below[j] - 2.0 * here[j], along_y = left + right - 2.0 * here[j];
        curvature[j] = sqrt(along_x * along_x + along_y * along_y);
    }
    for (size_t j = 1; j + 1 < ny; j++) {
        const double along_x = above[j] + below[j] - 2.0 * here[j], along_y = here[j - 1] + here[j + 1] - 2.0 * here[j];
        curvature[j] = sqrt(along_x * along_x + along_y * along_y);
    }
}

/* The cell of the scan that measures a cell of the plant with a shift of whole cells; false if it is not on the grid.
 */
bool scanned_cell(size_t nx, size_t ny, size_t cell, const double whole[SHIFTS], size_t *scanned);

/* Shift of whole cells, and the displacement that is left. */
Displacement split_displacement(const double displacement[DISPLACEMENTS], double whole[SHIFTS]);

/* The surface by the displacement before, `moved` from the one that the heights stand corrected for, and by `growth`.
 */
void surface_by(const ScanEvidence *evidence, const double moved[DISPLACEMENTS], double growth, double *surface);

/* The displacement of this scan, from the unknowns. */
void displacement_now(const double x[UNKNOWNS], double now[DISPLACEMENTS]);

/* The scan linearised about `x`: columns, what is left of each reading, and its weight without that of outliers.
 * `applied`: what the heights stand corrected for; `misfit`: variance of a reading per squared curvature [1]. False if
 * there is no memory. */
bool linearise(const ScanEvidence *evidence, const double applied[DISPLACEMENTS], double misfit,
               const double x[UNKNOWNS], Room *room);

#endif
