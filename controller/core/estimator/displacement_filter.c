#include "displacement_filter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "small_algebra.h"

/* Of the spread from scan to scan [cells^2]; of the predicted growth [1] before and after the ink is learnt (assumed).
 */
static const double SPREAD_STEP_STD = 1e-3, INK_FIRST_STD = 0.3, INK_STD = 0.03;
static const double LARGEST_SHIFT = 4.0, LARGEST_SPREAD = 16.0; /* [cells, cells^2] (assumed) */
/* Curvature of a wall in standard deviations: noise that a shift between cells averages is no evidence of one. */
static const double WALL = 4.0;
/* Standard deviations from which on a reading has Huber's weights, and none: a dead nozzle is no displacement (by
 * trial).
 */
static const double OUTLIER = 3.0, STRANGE = 6.0;
static const double CONVERGED = 1e-4; /* [cells] */
enum { ROUNDS = 8, REWEIGHTINGS = 2, ROUNDS_WITH_OUTLIERS = 3 };
_Static_assert((int)UNKNOWNS <= (int)UNKNOWNS_MAX, "they are solved for together");

bool room_open(Room *room, size_t cells) {
    double *next = room->memory = calloc(cells, (6 + UNKNOWNS + 4) * sizeof(double) + 1);
    if (!next)
        return false;
    double **single[] = {&room->surface, &room->growth, &room->reading, &room->weight, &room->rest, &room->curvature};
    for (size_t k = 0; k < sizeof single / sizeof *single; k++, next += cells)
        *single[k] = next;
    for (size_t k = 0; k < UNKNOWNS; k++, next += cells)
        room->columns[k] = next;
    room->scratch = next;
    room->is_wall = (uint8_t *)(next + 4 * cells);
    return true;
}

static double within(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

double curvature_at(size_t nx, size_t ny, const double *height, size_t cell) {
    const size_t i = cell / ny, j = cell % ny;
    const double here = height[cell];
    const double along_x = (i > 0 ? height[cell - ny] : here) + (i + 1 < nx ? height[cell + ny] : here) - 2.0 * here;
    const double along_y = (j > 0 ? height[cell - 1] : here) + (j + 1 < ny ? height[cell + 1] : here) - 2.0 * here;
    return sqrt(along_x * along_x + along_y * along_y);
}

bool scanned_cell(size_t nx, size_t ny, size_t cell, const double whole[SHIFTS], size_t *scanned) {
    const double i = (double)(cell / ny) - whole[0], j = (double)(cell % ny) - whole[1];
    *scanned = i < 0.0 || j < 0.0 ? 0 : (size_t)i * ny + (size_t)j;
    return i >= 0.0 && j >= 0.0 && i < (double)nx && j < (double)ny;
}

Displacement split_displacement(const double displacement[DISPLACEMENTS], double whole[SHIFTS]) {
    for (size_t k = 0; k < SHIFTS; k++)
        whole[k] = rint(displacement[k]);
    return (Displacement){displacement[SHIFT_X] - whole[0], displacement[SHIFT_Y] - whole[1], displacement[SPREAD]};
}

void surface_by(const ScanEvidence *evidence, const double moved[DISPLACEMENTS], double growth, double *surface) {
    const size_t cells = evidence->nx * evidence->ny;
    for (size_t cell = 0; cell < cells; cell++) {
        double height = evidence->predicted[cell] + growth * (evidence->predicted[cell] - evidence->before[cell]);
        for (size_t k = 0; k < DISPLACEMENTS; k++)
            height += moved[k] * evidence->response[k * cells + cell];
        surface[cell] = height;
    }
}

void displacement_now(const double x[UNKNOWNS], double now[DISPLACEMENTS]) {
    memcpy(now, x, DISPLACEMENTS * sizeof *now);
    for (size_t k = 0; k < SHIFTS; k++)
        now[k] += x[STEP + k];
}

/* The scan linearised about `x`: columns, what is left of each reading, and its weight without that of outliers. */
static void linearise(const ScanEvidence *evidence, const Registration *registration, const double x[UNKNOWNS],
                      const Room *room) {
    const size_t nx = evidence->nx, ny = evidence->ny, cells = nx * ny;
    double moved[DISPLACEMENTS], now[DISPLACEMENTS], whole[SHIFTS];
    displacement_now(x, now);
    const Displacement left = split_displacement(now, whole);
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        moved[k] = x[k] - registration->applied[k];
    surface_by(evidence, moved, x[GROWTH], room->surface);
    displaced_scan(nx, ny, room->surface, left, room->scratch, room->reading);
    displaced_scan_slopes(nx, ny, room->surface, left, room->scratch, room->columns[0]); /* they lie side by side */
    for (size_t k = 0; k < SHIFTS; k++)
        memcpy(room->columns[STEP + k], room->columns[k], cells * sizeof(double));
    for (size_t k = 0; k < DISPLACEMENTS; k++) {
        displaced_scan(nx, ny, evidence->response + k * cells, left, room->scratch, room->rest);
        for (size_t cell = 0; cell < cells; cell++)
            room->columns[k][cell] += room->rest[cell];
    }
    displaced_scan(nx, ny, room->growth, left, room->scratch, room->columns[GROWTH]);
    for (size_t cell = 0; cell < cells; cell++) {
        size_t scanned;
        const bool is_seen = scanned_cell(nx, ny, cell, whole, &scanned) && evidence->valid[scanned];
        const double curvature = room->curvature[cell] = curvature_at(nx, ny, room->surface, cell);
        const double sure = evidence->spread[cell] + evidence->noise_variance + READING_STD * READING_STD;
        const double variance = sure + registration->misfit * curvature * curvature;
        room->is_wall[cell] = curvature * curvature > WALL * WALL * sure;
        for (size_t k = 0; k < GROWTH && !room->is_wall[cell]; k++)
            room->columns[k][cell] = 0.0;
        room->rest[cell] = is_seen ? evidence->scan[scanned] - room->reading[cell] : 0.0;
        room->weight[cell] = is_seen ? 1.0 / variance : 0.0;
    }
}

double rest_after(const Room *room, const double move[UNKNOWNS], size_t cell) {
    double rest = room->rest[cell];
    for (size_t k = 0; k < UNKNOWNS; k++)
        rest -= move[k] * room->columns[k][cell];
    return rest;
}

/* Weight of a reading that a move leaves so far off, in standard deviations. */
static double robust_weight(double off, bool with_strange) {
    return off > STRANGE && !with_strange ? 0.0 : off > OUTLIER ? OUTLIER / off : 1.0;
}

/* The normal equations of a move with robust weights after the move `last`. */
static void normal_equations(size_t cells, const Room *room, const double last[UNKNOWNS], bool with_strange,
                             double *matrix, double side[UNKNOWNS]) {
    for (size_t cell = 0; cell < cells; cell++) {
        const double off = fabs(rest_after(room, last, cell)) * sqrt(room->weight[cell]);
        const double weight = room->weight[cell] * robust_weight(off, with_strange);
        if (weight == 0.0)
            continue;
        for (size_t i = 0; i < UNKNOWNS; i++) {
            const double weighted = weight * room->columns[i][cell];
            side[i] += weighted * room->rest[cell];
            for (size_t j = 0; j <= i; j++)
                matrix[i * UNKNOWNS + j] += weighted * room->columns[j][cell];
        }
    }
    for (size_t i = 0; i < UNKNOWNS; i++)
        for (size_t j = i + 1; j < UNKNOWNS; j++)
            matrix[i * UNKNOWNS + j] = matrix[j * UNKNOWNS + i];
}

/* Precision of the unknowns before the scan. */
static bool prior_precision(const ScanEvidence *evidence, const Registration *registration, double *precision) {
    double covariance[DISPLACEMENTS * DISPLACEMENTS], inverse[DISPLACEMENTS * DISPLACEMENTS];
    memcpy(covariance, registration->covariance, sizeof covariance);
    covariance[SPREAD * DISPLACEMENTS + SPREAD] += SPREAD_STEP_STD * SPREAD_STEP_STD;
    if (!invert_definite(DISPLACEMENTS, covariance, inverse))
        return false;
    memset(precision, 0, UNKNOWNS * UNKNOWNS * sizeof *precision);
    for (size_t i = 0; i < DISPLACEMENTS; i++)
        for (size_t j = 0; j < DISPLACEMENTS; j++)
            precision[i * UNKNOWNS + j] = inverse[i * DISPLACEMENTS + j];
    for (size_t k = STEP; k < GROWTH; k++)
        precision[k * UNKNOWNS + k] = 1.0 / registration->steps_variance;
    if (!evidence->has_spot)
        precision[SPREAD * UNKNOWNS + SPREAD] += 1.0 / (SPREAD_STEP_STD * SPREAD_STEP_STD);
    const double growth = evidence->is_first_layer ? INK_FIRST_STD : INK_STD;
    precision[GROWTH * UNKNOWNS + GROWTH] = 1.0 / (growth * growth);
    return true;
}

static void keep_within(double x[UNKNOWNS]) {
    for (size_t k = 0; k < SHIFTS; k++)
        x[k] = within(x[k], -LARGEST_SHIFT, LARGEST_SHIFT);
    x[SPREAD] = within(x[SPREAD], 0.0, LARGEST_SPREAD);
}

bool likeliest_displacement(const ScanEvidence *evidence, const Registration *registration, bool is_iterated,
                            const Room *room, double x[UNKNOWNS], double *covariance) {
    double precision[UNKNOWNS * UNKNOWNS], matrix[UNKNOWNS * UNKNOWNS], before[UNKNOWNS] = {0.0};
    if (!prior_precision(evidence, registration, precision))
        return false;
    memcpy(before, registration->estimate, DISPLACEMENTS * sizeof *before);
    memcpy(x, before, sizeof before);
    if (!is_iterated)
        memcpy(x, registration->applied, sizeof registration->applied);
    const int rounds = evidence->is_unknown ? 0 : is_iterated ? ROUNDS : 1;
    memcpy(matrix, precision, sizeof matrix);
    linearise(evidence, registration, x, room);
    for (int round = 0; round < rounds; round++) {
        double move[UNKNOWNS] = {0.0}, largest = 0.0;
        if (round > 0)
            linearise(evidence, registration, x, room);
        for (int weighing = 0; weighing < REWEIGHTINGS; weighing++) {
            double side[UNKNOWNS] = {0.0};
            memcpy(matrix, precision, sizeof matrix);
            for (size_t i = 0; i < UNKNOWNS; i++)
                for (size_t j = 0; j < UNKNOWNS; j++)
                    side[i] += precision[i * UNKNOWNS + j] * (before[j] - x[j]);
            normal_equations(evidence->nx * evidence->ny, room, move, round < ROUNDS_WITH_OUTLIERS, matrix, side);
            if (!solve_definite(UNKNOWNS, matrix, side))
                return false;
            memcpy(move, side, sizeof move);
        }
        for (size_t k = 0; k < UNKNOWNS; k++) {
            largest = fmax(largest, fabs(move[k]));
            x[k] += move[k];
        }
        keep_within(x);
        if (largest < CONVERGED && round >= ROUNDS_WITH_OUTLIERS)
            break;
    }
    return invert_definite(UNKNOWNS, matrix, covariance);
}
