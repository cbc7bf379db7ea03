/* The filter under the registration of scans: which displacement makes a predicted scan likeliest.
 *
 * An iterated extended Kalman filter on six unknowns, with robust weights of the readings. It decides nothing:
 * scan_registration.c does. */
#ifndef INKLOOP_DISPLACEMENT_FILTER_H
#define INKLOOP_DISPLACEMENT_FILTER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "displaced_scan.h"

enum { SHIFT_X, SHIFT_Y, SPREAD, DISPLACEMENTS };

typedef struct {
    double estimate[DISPLACEMENTS];                   /* of the last scan [cells, cells, cells^2] */
    double covariance[DISPLACEMENTS * DISPLACEMENTS]; /* of its error */
    double applied[DISPLACEMENTS];                    /* what the heights stand corrected for; 0 before the evidence */
    double steps_variance;                            /* learnt: of the shift from scan to scan [cells^2] */
    double misfit;                                    /* learnt: variance of a reading per squared curvature [1] */
    double far_product, far_information; /* of readings beyond the reach of droplets: what a spot spreads there [1], and
                                            how much it would for each unit of its spread [1 per cells^4] */
    int64_t scans;                       /* that it is learnt from */
    int32_t has_shift;                   /* whether scans are corrected for a shift, */
    int32_t has_wide_spot;               /* and for a spot */
} Registration;

/* What is known of a surface before a scan; maps of nx * ny cells in C order. */
typedef struct {
    size_t nx, ny;
    const double *before, *predicted; /* heights before the layer and after it [m] */
    const double *spread;             /* variance of the prediction [m^2] */
    const double *response;           /* DISPLACEMENTS maps [m per unit of the estimate] */
    const double *scan;               /* [m] */
    const uint8_t *valid;
    const uint8_t *part;   /* cells that droplets fall on, and reach to their neighbours */
    double noise_variance; /* of a reading [m^2] */
    double unsure;         /* error of a growth from which on it shows neither ink nor dead cells [m] */
    bool is_first_layer;   /* the ink is not known yet */
    bool is_unknown;       /* it is not known how much of the layer was jetted: nothing is learnt */
    bool has_spot;         /* a spot is looked for: wider droplets would look alike */
} ScanEvidence;

/* Unknowns of a scan: displacement before, step of the shift since, growth beyond the predicted one. */
enum { STEP = DISPLACEMENTS, SHIFTS = 2, GROWTH = STEP + SHIFTS, UNKNOWNS };

#define READING_STD 2e-8 /* least error of a reading at a wall [m] (assumed) */

/* Maps of one registration. */
typedef struct {
    double *surface, *growth, *reading;
    double *columns[UNKNOWNS]; /* how the reading of each cell goes with each unknown */
    double *weight, *rest, *curvature, *scratch;
    uint8_t *is_wall; /* cells that a displacement moves beyond their noise */
    void *memory;
} Room;

/* False if there is no memory; `memory` is the caller's to free. */
bool room_open(Room *room, size_t cells);

/* Size of the second differences at a cell [m]. */
double curvature_at(size_t nx, size_t ny, const double *height, size_t cell);

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

/* What a move of the unknowns leaves of the reading of a cell. */
double rest_after(const Room *room, const double move[UNKNOWNS], size_t cell);

/* The likeliest unknowns and their covariance: by an iterated extended Kalman filter, or by one linear step from what
 * is applied. Between cells a displaced scan averages noise, which makes any displacement likelier than none; the
 * linear step is free of that. False if they cannot be solved for. */
bool likeliest_displacement(const ScanEvidence *evidence, const Registration *registration, bool is_iterated,
                            const Room *room, double x[UNKNOWNS], double *covariance);

#endif
