#include "scan_registration.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "near_cells.h"
#include "small_algebra.h"

/* Before any scan, and from scan to scan [cells, cells^2] (assumed); the step of the shift is learnt. */
static const double SHIFT_STD = 0.5, SPREAD_STD = 0.5, STEP_STD = 0.03, SPREAD_STEP_STD = 1e-3;
/* Of the predicted growth [1] before and after the ink is learnt; least error of a reading at a wall [m] (assumed). */
static const double INK_FIRST_STD = 0.3, INK_STD = 0.03, READING_STD = 2e-8;
/* Error of a reading per curvature [1], and the weight of what earlier scans showed of it (by trial). */
static const double MISFIT_FIRST = 0.05, MISFIT_LEAST = 0.01, MISFIT_KEPT = 0.7;
/* Squared standard deviations from 0; by chance once in three million scans, for two axes. */
static const double BEYOND_DOUBT = 30.0;
/* The least that is corrected [cells, cells^2: a spot of 0.41 cells]: droplets of another shape than expected look like
 * less, and like a spot that readings near droplets and far from them show to differ by more than a share (by trial).
 */
static const double SHIFT_VISIBLE = 0.05, SPREAD_VISIBLE = 0.1, SAME_SPOT = 0.25;
static const double LARGEST_SHIFT = 4.0, LARGEST_SPREAD = 16.0; /* [cells, cells^2] (assumed) */
/* Curvature of a wall in standard deviations: noise that a shift between cells averages is no evidence of one. */
static const double WALL = 4.0;
/* Standard deviations from which on a reading has Huber's weights, and none: a dead nozzle is no displacement (by
 * trial).
 */
static const double OUTLIER = 3.0, STRANGE = 6.0;
static const double CONVERGED = 1e-4; /* [cells] */
enum { ROUNDS = 8, REWEIGHTINGS = 2, ROUNDS_WITH_OUTLIERS = 3 };
/* Unknowns of a scan: displacement before, step of the shift since, growth beyond the predicted one. */
enum { STEP = DISPLACEMENTS, SHIFTS = 2, GROWTH = STEP + SHIFTS, UNKNOWNS };
_Static_assert((int)UNKNOWNS <= (int)UNKNOWNS_MAX, "they are solved for together");

/* Maps of one registration. */
typedef struct {
    double *surface, *growth, *reading;
    double *columns[UNKNOWNS]; /* how the reading of each cell goes with each unknown */
    double *weight, *rest, *curvature, *scratch;
    uint8_t *is_wall; /* cells that a displacement moves beyond their noise */
    void *memory;
} Room;

static bool room_open(Room *room, size_t cells) {
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

Registration no_registration(void) {
    return (Registration){.covariance = {SHIFT_STD * SHIFT_STD, 0.0, 0.0, 0.0, SHIFT_STD * SHIFT_STD, 0.0, 0.0, 0.0,
                                         SPREAD_STD * SPREAD_STD},
                          .steps_variance = STEP_STD * STEP_STD,
                          .misfit = MISFIT_FIRST * MISFIT_FIRST};
}

Displacement expected_displacement(const Registration *registration) {
    const double *applied = registration->applied;
    return (Displacement){applied[SHIFT_X], applied[SHIFT_Y], applied[SPREAD]};
}

ScanDisplacement reported_displacement(const Registration *registration) {
    const double *estimate = registration->estimate, *covariance = registration->covariance;
    const double larger = fmax(covariance[0], covariance[DISPLACEMENTS + 1]);
    const double error = sqrt(covariance[SPREAD * DISPLACEMENTS + SPREAD]);
    const double spread = registration->has_wide_spot ? estimate[SPREAD] : 0.0, radius = spot_radius(spread);
    return (ScanDisplacement){estimate[SHIFT_X], estimate[SHIFT_Y], sqrt(larger), radius,
                              spot_radius(spread + error) - radius};
}

bool first_response(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double *response) {
    const size_t cells = nx * ny;
    double *scratch = malloc(cells * (4 * sizeof(double) + 1));
    if (!scratch)
        return false;
    uint8_t *unseen = (uint8_t *)(scratch + 4 * cells);
    for (size_t cell = 0; cell < cells; cell++)
        unseen[cell] = !valid[cell];
    displaced_scan_slopes(nx, ny, scan, (Displacement){0.0, 0.0, 0.0}, scratch, response);
    for (size_t cell = 0; cell < cells; cell++)
        for (size_t k = 0; k < DISPLACEMENTS; k++)
            response[k * cells + cell] = is_near_marked(unseen, nx, ny, cell) ? 0.0 : -response[k * cells + cell];
    free(scratch);
    return true;
}

static double within(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

/* Size of the second differences at a cell [m]. */
static double curvature_at(size_t nx, size_t ny, const double *height, size_t cell) {
    const size_t i = cell / ny, j = cell % ny;
    const double here = height[cell];
    const double along_x = (i > 0 ? height[cell - ny] : here) + (i + 1 < nx ? height[cell + ny] : here) - 2.0 * here;
    const double along_y = (j > 0 ? height[cell - 1] : here) + (j + 1 < ny ? height[cell + 1] : here) - 2.0 * here;
    return sqrt(along_x * along_x + along_y * along_y);
}

/* The cell of the scan that measures a cell of the plant with a shift of whole cells; false if it is not on the grid.
 */
static bool scanned_cell(size_t nx, size_t ny, size_t cell, const double whole[SHIFTS], size_t *scanned) {
    const double i = (double)(cell / ny) - whole[0], j = (double)(cell % ny) - whole[1];
    *scanned = i < 0.0 || j < 0.0 ? 0 : (size_t)i * ny + (size_t)j;
    return i >= 0.0 && j >= 0.0 && i < (double)nx && j < (double)ny;
}

/* Shift of whole cells, and the displacement that is left. */
static Displacement split(const double displacement[DISPLACEMENTS], double whole[SHIFTS]) {
    for (size_t k = 0; k < SHIFTS; k++)
        whole[k] = rint(displacement[k]);
    return (Displacement){displacement[SHIFT_X] - whole[0], displacement[SHIFT_Y] - whole[1], displacement[SPREAD]};
}

/* The surface by the displacement before, `moved` from the one that the heights stand corrected for, and by `growth`.
 */
static void surface_by(const ScanEvidence *evidence, const double moved[DISPLACEMENTS], double growth,
                       double *surface) {
    const size_t cells = evidence->nx * evidence->ny;
    for (size_t cell = 0; cell < cells; cell++) {
        double height = evidence->predicted[cell] + growth * (evidence->predicted[cell] - evidence->before[cell]);
        for (size_t k = 0; k < DISPLACEMENTS; k++)
            height += moved[k] * evidence->response[k * cells + cell];
        surface[cell] = height;
    }
}

static void displacement_now(const double x[UNKNOWNS], double now[DISPLACEMENTS]) {
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
    const Displacement left = split(now, whole);
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

/* What a move of the unknowns leaves of the reading of a cell. */
static double rest_after(const Room *room, const double move[UNKNOWNS], size_t cell) {
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

/* Inverse of a positive definite matrix of n * n; false if it is singular. */
static bool invert(size_t n, const double *matrix, double *inverse) {
    for (size_t k = 0; k < n; k++) {
        double column[UNKNOWNS] = {0.0};
        column[k] = 1.0;
        if (!solve_definite(n, matrix, column))
            return false;
        for (size_t i = 0; i < n; i++)
            inverse[i * n + k] = column[i];
    }
    return true;
}

/* Precision of the unknowns before the scan. */
static bool prior_precision(const ScanEvidence *evidence, const Registration *registration, double *precision) {
    double covariance[DISPLACEMENTS * DISPLACEMENTS], inverse[DISPLACEMENTS * DISPLACEMENTS];
    memcpy(covariance, registration->covariance, sizeof covariance);
    covariance[SPREAD * DISPLACEMENTS + SPREAD] += SPREAD_STEP_STD * SPREAD_STEP_STD;
    if (!invert(DISPLACEMENTS, covariance, inverse))
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

/* The likeliest unknowns and their covariance: by an iterated extended Kalman filter, or by one linear step from what
 * is applied. Between cells a displaced scan averages noise, which makes any displacement likelier than none; the
 * linear step is free of that. False if they cannot be solved for. */
static bool likeliest(const ScanEvidence *evidence, const Registration *registration, bool is_iterated,
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
    return invert(UNKNOWNS, matrix, covariance);
}

/* Covariance of the displacement now with the unknowns (DISPLACEMENTS * UNKNOWNS). */
static void covariance_of_now(const double *covariance, double *with) {
    for (size_t i = 0; i < DISPLACEMENTS; i++)
        for (size_t j = 0; j < UNKNOWNS; j++)
            with[i * UNKNOWNS + j] =
                covariance[i * UNKNOWNS + j] + (i < SHIFTS ? covariance[(STEP + i) * UNKNOWNS + j] : 0.0);
}

/* How the displacement before goes with the one now, and what is left of it. */
static bool project(const double *with, const double *now, const double *covariance, RegisteredScan *registered) {
    double precision[DISPLACEMENTS * DISPLACEMENTS];
    if (!invert(DISPLACEMENTS, now, precision))
        return false;
    for (size_t i = 0; i < DISPLACEMENTS; i++) {
        for (size_t j = 0; j < DISPLACEMENTS; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < DISPLACEMENTS; k++)
                sum += with[k * UNKNOWNS + i] * precision[k * DISPLACEMENTS + j];
            registered->previous[i * DISPLACEMENTS + j] = sum;
        }
    }
    for (size_t i = 0; i < DISPLACEMENTS; i++) {
        for (size_t j = 0; j < DISPLACEMENTS; j++) {
            double sum = covariance[i * UNKNOWNS + j];
            for (size_t k = 0; k < DISPLACEMENTS; k++)
                sum -= registered->previous[i * DISPLACEMENTS + k] * with[k * UNKNOWNS + j];
            registered->rest[i * DISPLACEMENTS + j] = sum;
        }
    }
    return true;
}

/* Mean square of what is left of the readings that the displacement moves, in variances; the more it moves one, the
 * more that counts. Where it explains them this is 1 or less. */
static double unexplained(size_t cells, const Room *room, const double displacement[DISPLACEMENTS]) {
    double sum = 0.0, total = 0.0;
    for (size_t cell = 0; cell < cells; cell++) {
        double moved = 0.0;
        for (size_t k = 0; k < DISPLACEMENTS; k++)
            moved += displacement[k] * room->columns[k][cell];
        const double weight = room->weight[cell] * moved * moved;
        sum += weight * room->weight[cell] * room->rest[cell] * room->rest[cell];
        total += weight;
    }
    return total > 0.0 ? sum / total : 1.0;
}

/* Adds what a spot spreads beyond the reach of droplets; wider droplets look like a spot everywhere else. */
static void look_far(const ScanEvidence *evidence, const Room *room, double spread, Registration *registration) {
    for (size_t cell = 0; cell < evidence->nx * evidence->ny; cell++) {
        if (is_near_marked(evidence->part, evidence->nx, evidence->ny, cell))
            continue;
        const double slope = room->columns[SPREAD][cell], rest = room->rest[cell] + spread * slope;
        registration->far_product += room->weight[cell] * slope * rest;
        registration->far_information += room->weight[cell] * slope * slope;
    }
}

/* Whether readings beyond the reach of droplets show a spot, the same as all others as far as that is known. */
static bool shows_far(const Registration *registration, bool is_iterated) {
    const double product = registration->far_product, information = registration->far_information;
    const double spread = registration->estimate[SPREAD];
    if (product <= 0.0 || product * product <= BEYOND_DOUBT * information)
        return false;
    return !is_iterated || fabs(product / information - spread) < SAME_SPOT * spread + OUTLIER / sqrt(information);
}

/* What the evidence says beyond doubt; once it did, it stays. */
static void decide(bool has_spot, bool is_iterated, double doubt, Registration *registration) {
    const double *shift = registration->estimate, *covariance = registration->covariance;
    double block[SHIFTS * SHIFTS], solved[SHIFTS] = {shift[0], shift[1]};
    for (size_t i = 0; i < SHIFTS; i++)
        for (size_t j = 0; j < SHIFTS; j++)
            block[i * SHIFTS + j] = covariance[i * DISPLACEMENTS + j];
    if (solve_definite(SHIFTS, block, solved) && shift[0] * solved[0] + shift[1] * solved[1] > doubt &&
        hypot(shift[0], shift[1]) > SHIFT_VISIBLE)
        registration->has_shift = 1;
    const double spread = registration->estimate[SPREAD];
    if (has_spot && shows_far(registration, is_iterated) && spread > SPREAD_VISIBLE &&
        spread * spread > doubt * covariance[SPREAD * DISPLACEMENTS + SPREAD])
        registration->has_wide_spot = 1;
}

static bool is_applied(const Registration *registration, size_t k) {
    return k == SPREAD ? registration->has_wide_spot : registration->has_shift;
}

static void learn_steps(Registration *registration, const double x[UNKNOWNS], const double *covariance) {
    double found = 0.0;
    for (size_t k = STEP; k < GROWTH; k++)
        found += 0.5 * (x[k] * x[k] + covariance[k * UNKNOWNS + k]);
    registration->scans += 1;
    registration->steps_variance += (found - registration->steps_variance) / (1.0 + (double)registration->scans);
}

static void learn_misfit(size_t cells, const Room *room, Registration *registration) {
    const double none[UNKNOWNS] = {0.0};
    double product = 0.0, squares = 0.0;
    for (size_t cell = 0; cell < cells; cell++) {
        if (room->weight[cell] == 0.0)
            continue;
        const double rest = rest_after(room, none, cell), curvature = room->curvature[cell] * room->curvature[cell];
        product += rest * rest * curvature;
        squares += curvature * curvature;
    }
    const double found = squares > 0.0 ? fmax(product / squares, MISFIT_LEAST * MISFIT_LEAST) : registration->misfit;
    registration->misfit = MISFIT_KEPT * registration->misfit + (1.0 - MISFIT_KEPT) * found;
}

/* The scan as it would be in register: what the displacement that is applied changes in the predicted scan, taken off.
 */
static void correct_scan(const ScanEvidence *evidence, const Registration *registration, const double x[UNKNOWNS],
                         const double before[DISPLACEMENTS], const Room *room, RegisteredScan *registered) {
    const size_t nx = evidence->nx, ny = evidence->ny, cells = nx * ny;
    double moved[DISPLACEMENTS], whole[SHIFTS];
    const Displacement left = split(registration->applied, whole);
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        moved[k] = is_applied(registration, k) ? x[k] - before[k] : 0.0;
    surface_by(evidence, moved, x[GROWTH], room->surface);
    displaced_scan(nx, ny, room->surface, left, room->scratch, room->reading);
    for (size_t cell = 0; cell < cells; cell++) {
        size_t scanned;
        registered->seen[cell] = scanned_cell(nx, ny, cell, whole, &scanned) && evidence->valid[scanned];
        registered->scan[cell] =
            registered->seen[cell] ? evidence->scan[scanned] - room->reading[cell] + room->surface[cell] : 0.0;
        registered->before[cell] = evidence->before[cell];
        for (size_t k = 0; k < DISPLACEMENTS; k++)
            registered->before[cell] += moved[k] * evidence->response[k * cells + cell];
        const double curvature = curvature_at(nx, ny, room->surface, cell);
        registered->variance[cell] = READING_STD * READING_STD + registration->misfit * curvature * curvature;
    }
}

/* Marks the cells that were seen and whose growth the displacement leaves sure. */
static void mark_clear(const ScanEvidence *evidence, const Registration *registration, RegisteredScan *registered) {
    const size_t cells = evidence->nx * evidence->ny;
    const double limit = evidence->unsure * evidence->unsure;
    for (size_t cell = 0; cell < cells; cell++) {
        const double error = displacement_variance(registration, registered->sensitivity, cells, cell);
        registered->clear[cell] = registered->seen[cell] && error + registered->variance[cell] < limit;
    }
}

bool is_displaced(const Registration *registration) {
    return registration->has_shift || registration->has_wide_spot;
}

void take_as_read(const ScanEvidence *evidence, RegisteredScan *registered) {
    const size_t cells = evidence->nx * evidence->ny;
    memcpy(registered->before, evidence->before, cells * sizeof(double));
    memcpy(registered->scan, evidence->scan, cells * sizeof(double));
    memset(registered->variance, 0, cells * sizeof(double));
    memcpy(registered->seen, evidence->valid, cells);
    memcpy(registered->clear, evidence->valid, cells);
}

/* The estimate after the scan, from the likeliest unknowns. */
static bool update(const double x[UNKNOWNS], const double *covariance, Registration *registration,
                   RegisteredScan *registered) {
    double with[DISPLACEMENTS * UNKNOWNS], now[DISPLACEMENTS * DISPLACEMENTS];
    covariance_of_now(covariance, with);
    for (size_t i = 0; i < DISPLACEMENTS; i++)
        for (size_t j = 0; j < DISPLACEMENTS; j++)
            now[i * DISPLACEMENTS + j] = with[i * UNKNOWNS + j] + (j < SHIFTS ? with[i * UNKNOWNS + STEP + j] : 0.0);
    if (!project(with, now, covariance, registered))
        return false;
    displacement_now(x, registration->estimate);
    memcpy(registration->covariance, now, sizeof now);
    return true;
}

/* Learns from a scan, iterated or not. False if the unknowns cannot be solved for. */
static bool learn(const ScanEvidence *evidence, bool is_iterated, const Room *room, double x[UNKNOWNS],
                  Registration *registration, RegisteredScan *registered) {
    const size_t cells = evidence->nx * evidence->ny;
    double covariance[UNKNOWNS * UNKNOWNS];
    if (!likeliest(evidence, registration, is_iterated, room, x, covariance) ||
        !update(x, covariance, registration, registered))
        return false;
    if (evidence->is_unknown)
        return true;
    learn_steps(registration, x, covariance);
    look_far(evidence, room, is_iterated ? x[SPREAD] : 0.0, registration);
    const double unclear = is_iterated ? fmax(1.0, unexplained(cells, room, registration->estimate)) : 1.0;
    decide(evidence->has_spot, is_iterated, BEYOND_DOUBT * unclear, registration);
    learn_misfit(cells, room, registration);
    return true;
}

/* A displacement that the linear step finds is to stand the iteration, else nothing is corrected. */
static bool learn_and_confirm(const ScanEvidence *evidence, const Room *room, double x[UNKNOWNS],
                              Registration *registration, RegisteredScan *registered) {
    const Registration before = *registration;
    if (is_displaced(&before))
        return learn(evidence, true, room, x, registration, registered);
    if (!learn(evidence, false, room, x, registration, registered))
        return false;
    if (!is_displaced(registration))
        return true;
    *registration = before;
    if (!learn(evidence, true, room, x, registration, registered))
        return false;
    if (is_displaced(registration))
        return true;
    *registration = before;
    const bool is_learnt = learn(evidence, false, room, x, registration, registered);
    registration->has_shift = registration->has_wide_spot = 0;
    return is_learnt;
}

bool register_scan(const ScanEvidence *evidence, Registration *registration, RegisteredScan *registered) {
    const size_t cells = evidence->nx * evidence->ny;
    const Registration before = *registration;
    double x[UNKNOWNS];
    Room room;
    if (!room_open(&room, cells))
        return false;
    for (size_t cell = 0; cell < cells; cell++)
        room.growth[cell] = evidence->predicted[cell] - evidence->before[cell];
    if (!learn_and_confirm(evidence, &room, x, registration, registered)) {
        free(room.memory); /* singular to rounding: with the prior in them these equations never are */
        return false;
    }
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        for (size_t cell = 0; cell < cells; cell++)
            registered->sensitivity[k * cells + cell] =
                room.is_wall[cell] ? room.columns[k][cell] : evidence->response[k * cells + cell];
    memcpy(registered->slopes, room.columns[STEP], SHIFTS * cells * sizeof(double));
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        registration->applied[k] = is_applied(registration, k) ? registration->estimate[k] : 0.0;
    if (is_displaced(registration)) {
        correct_scan(evidence, registration, x, before.applied, &room, registered);
        mark_clear(evidence, registration, registered);
    } else
        take_as_read(evidence, registered);
    free(room.memory);
    return true;
}

void carry_response(size_t cells, const RegisteredScan *registered, const double *before, const double *gain,
                    double *response, double *variance) {
    for (size_t cell = 0; cell < cells; cell++) {
        double old[DISPLACEMENTS], step[DISPLACEMENTS] = {0.0}, left[DISPLACEMENTS];
        for (size_t k = 0; k < DISPLACEMENTS; k++)
            old[k] = before[k * cells + cell] - gain[cell] * registered->sensitivity[k * cells + cell];
        for (size_t k = 0; k < SHIFTS; k++)
            step[k] = -gain[cell] * registered->slopes[k * cells + cell];
        for (size_t k = 0; k < DISPLACEMENTS; k++) {
            left[k] = old[k] - step[k];
            response[k * cells + cell] = step[k];
        }
        for (size_t i = 0; i < DISPLACEMENTS; i++)
            for (size_t j = 0; j < DISPLACEMENTS; j++) {
                response[j * cells + cell] += left[i] * registered->previous[i * DISPLACEMENTS + j];
                if (variance)
                    variance[cell] += left[i] * registered->rest[i * DISPLACEMENTS + j] * left[j];
            }
    }
}

double displacement_variance(const Registration *registration, const double *response, size_t cells, size_t cell) {
    double sum = 0.0;
    for (size_t i = 0; i < DISPLACEMENTS; i++)
        for (size_t j = 0; j < DISPLACEMENTS; j++)
            sum += response[i * cells + cell] * registration->covariance[i * DISPLACEMENTS + j] *
                   response[j * cells + cell];
    return sum;
}
