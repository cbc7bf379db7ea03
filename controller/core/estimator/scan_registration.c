#include "scan_registration.h"

#include <math.h>
#include <string.h>

#include "small_algebra.h"

/* Before any scan, and from scan to scan [cells, cells^2] (assumed); the step of the shift is learnt. */
static const double SHIFT_STD = 0.5, SPREAD_STD = 0.5, STEP_STD = 0.03;
/* Error of a reading per curvature [1], and the weight of what earlier scans showed of it (by trial). */
static const double MISFIT_FIRST = 0.05, MISFIT_LEAST = 0.01, MISFIT_KEPT = 0.7;
/* Squared standard deviations from 0; by chance once in three million scans, for two axes. */
static const double BEYOND_DOUBT = 30.0;
/* The least that is corrected [cells, cells^2: a spot of 0.41 cells]: droplets of another shape than expected look like
 * less, and like a spot that readings near droplets and far from them show to differ by more than a share, and by more
 * than so many standard deviations (by trial). */
static const double SHIFT_VISIBLE = 0.05, SPREAD_VISIBLE = 0.1, SAME_SPOT = 0.25, SAME_SPOT_STD = 3.0;

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
    if (!invert_definite(DISPLACEMENTS, now, precision))
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
    for (size_t cell = 0, wall = 0; cell < cells; cell++) {
        const size_t place = column_place(&room->columns, cell, &wall);
        double moved = 0.0;
        if (!room->is_wall[cell])
            continue;
        for (size_t k = 0; k < DISPLACEMENTS; k++)
            moved += displacement[k] * room->columns.of[k][place];
        const double weight = room->weight[cell] * moved * moved;
        sum += weight * room->weight[cell] * room->rest[cell] * room->rest[cell];
        total += weight;
    }
    return total > 0.0 ? sum / total : 1.0;
}

/* What readings show of a spot beyond the reach of droplets, and of the misfit, in the rows of a chunk. */
typedef struct {
    double product, information; /* far_product, far_information */
    double misfits, quartics;
} LookSums;

/* What the threads share. */
typedef struct {
    const ScanEvidence *evidence;
    const Room *room;
    double spread;
    LookSums sums[CHUNKS];
} Look;

/* Adds what a spot spreads beyond the reach of droplets; wider droplets look like a spot everywhere else. */
static INLINED void look_far(const Look *look, size_t first, size_t count, size_t *wall, LookSums *sums) {
    const ScanEvidence *evidence = look->evidence;
    const Room *room = look->room;
    const uint8_t *is_wall = room->is_wall + first, *reached = evidence->reached + first;
    uint8_t far[BLOCK]; /* away from walls the slope is 0 */
    for (size_t k = 0; k < count; k++)
        far[k] = is_wall[k] & (reached[k] == 0);
    if (!memchr(far, 1, count)) {
        *wall += count_marked(is_wall, count);
        return;
    }
    for (size_t cell = first; cell < first + count; cell++) {
        const size_t place = column_place(&room->columns, cell, wall);
        if (!far[cell - first])
            continue;
        const double slope = room->columns.of[SPREAD][place], rest = room->rest[cell] + look->spread * slope;
        sums->product += room->weight[cell] * slope * rest;
        sums->information += room->weight[cell] * slope * slope;
    }
}

/* Adds what is left of readings where the surface is curved. */
static INLINED void add_misfits(const Room *room, size_t first, size_t count, LookSums *sums) {
    const double *rest = room->rest + first, *curved = room->curvature + first, *weight = room->weight + first;
    double misfits[BLOCK], quartics[BLOCK];
    for (size_t k = 0; k < count; k++) {
        const double curvature = curved[k] * curved[k];
        misfits[k] = weight[k] == 0.0 ? 0.0 : rest[k] * rest[k] * curvature;
        quartics[k] = weight[k] == 0.0 ? 0.0 : curvature * curvature;
    }
    sums->misfits += lane_sum(misfits, count);
    sums->quartics += lane_sum(quartics, count);
}

static INLINED void look_at_rows(void *context, const RowRange *range) {
    Look *look = context;
    const size_t nx = look->evidence->nx, ny = look->evidence->ny;
    const Room *room = look->room;
    size_t wall = room->columns.before[range->chunk];
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t end = chunk_row(nx, chunk + 1) * ny;
        LookSums sums = {0.0, 0.0, 0.0, 0.0};
        for (size_t first = chunk_row(nx, chunk) * ny; first < end; first += BLOCK) {
            const size_t count = end - first < BLOCK ? end - first : BLOCK;
            if (memchr(room->is_wall + first, 1, count))
                look_far(look, first, count, &wall, &sums);
            add_misfits(room, first, count, &sums);
        }
        look->sums[chunk] = sums;
    }
}

CLONED_ROW_WORK(look_at_range, look_at_rows)

/* The sums of all rows; `spread`: that the scan is linearised about. */
static LookSums look_at_readings(const ScanEvidence *evidence, const Room *room, double spread) {
    Look look = {.evidence = evidence, .room = room, .spread = spread};
    LookSums all = {0.0, 0.0, 0.0, 0.0};
    run_rows(room->threads, evidence->nx, evidence->ny, look_at_range, &look);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        all.product += look.sums[chunk].product;
        all.information += look.sums[chunk].information;
        all.misfits += look.sums[chunk].misfits;
        all.quartics += look.sums[chunk].quartics;
    }
    return all;
}

/* Whether readings beyond the reach of droplets show a spot, the same as all others as far as that is known. */
static bool shows_far(const Registration *registration, bool is_iterated) {
    const double product = registration->far_product, information = registration->far_information;
    const double spread = registration->estimate[SPREAD];
    if (product <= 0.0 || product * product <= BEYOND_DOUBT * information)
        return false;
    return !is_iterated ||
           fabs(product / information - spread) < SAME_SPOT * spread + SAME_SPOT_STD / sqrt(information);
}

/* What the evidence says beyond doubt. A shift that leaves readings unexplained (doubt above the least) is to say so
 * again in each scan: droplets that differ from the model look like a shift in one layer, and like another in the next.
 */
static void decide(bool is_iterated, double doubt, Registration *registration) {
    const double *shift = registration->estimate, *covariance = registration->covariance;
    double block[SHIFTS * SHIFTS], solved[SHIFTS] = {shift[0], shift[1]};
    for (size_t i = 0; i < SHIFTS; i++)
        for (size_t j = 0; j < SHIFTS; j++)
            block[i * SHIFTS + j] = covariance[i * DISPLACEMENTS + j];
    const bool is_solved = solve_definite(SHIFTS, block, solved);
    const bool is_beyond = is_solved && shift[0] * solved[0] + shift[1] * solved[1] > doubt;
    if (is_beyond && hypot(shift[0], shift[1]) > SHIFT_VISIBLE)
        registration->has_shift = 1;
    if (!is_beyond && doubt > BEYOND_DOUBT && !registration->has_wide_spot)
        registration->has_shift = 0;
    const double spread = registration->estimate[SPREAD];
    if (shows_far(registration, is_iterated) && spread > SPREAD_VISIBLE &&
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

static void learn_misfit(const LookSums *sums, Registration *registration) {
    const double least = MISFIT_LEAST * MISFIT_LEAST;
    const double found = sums->quartics > 0.0 ? fmax(sums->misfits / sums->quartics, least) : registration->misfit;
    registration->misfit = MISFIT_KEPT * registration->misfit + (1.0 - MISFIT_KEPT) * found;
}

/* The scan as it would be in register: what the displacement that is applied changes in the predicted scan, taken off.
 */
static void correct_scan(const ScanEvidence *evidence, const Registration *registration, const double x[UNKNOWNS],
                         const double before[DISPLACEMENTS], const Room *room) {
    const size_t nx = evidence->nx, ny = evidence->ny, cells = nx * ny;
    const Patch grid = {0, nx, 0, ny};
    const MovedMaps *maps = &room->moved;
    const Scratch scratch = {maps->scratch, 0, nx};
    const double *reading = scratch_map(&scratch, ny, SCRATCH_MAPS - 1).values;
    double moved[DISPLACEMENTS], whole[SHIFTS], *surface = maps->surface;
    const DisplacedView left = displaced_view(split_displacement(registration->applied, whole));
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        moved[k] = is_applied(registration, k) ? x[k] - before[k] : 0.0;
    surface_by(evidence, moved, x[GROWTH], surface);
    for (size_t i = 0; i < nx; i++)
        curvature_of_row(nx, ny, surface, i, room->curvature + i * ny);
    displaced_scan(nx, ny, surface, &left, &grid, &scratch, scratch_map(&scratch, ny, SCRATCH_MAPS - 1));
    for (size_t cell = 0; cell < cells; cell++) {
        size_t scanned;
        maps->seen[cell] = scanned_cell(nx, ny, cell, whole, &scanned) && evidence->valid[scanned];
        maps->scan[cell] = maps->seen[cell] ? evidence->scan[scanned] - reading[cell] + surface[cell] : 0.0;
        maps->before[cell] = evidence->before[cell];
        for (size_t k = 0; k < DISPLACEMENTS; k++)
            maps->before[cell] += moved[k] * evidence->response[k * cells + cell];
        const double curvature = room->curvature[cell];
        maps->misread[cell] = READING_STD * READING_STD + registration->misfit * curvature * curvature;
    }
}

/* How the innovation of a cell goes with the displacement before. */
static void sensitivity_of(const WallColumns *columns, const double *response, size_t cells, size_t cell, size_t *wall,
                           double sensitivity[DISPLACEMENTS]) {
    const size_t place = column_place(columns, cell, wall);
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        sensitivity[k] = columns->is_wall[cell] ? columns->of[k][place] : response[k * cells + cell];
}

/* Marks the cells that were seen and whose growth the displacement leaves sure. */
static void mark_clear(const ScanEvidence *evidence, const Registration *registration, const RegisteredScan *registered,
                       uint8_t *clear) {
    const size_t cells = evidence->nx * evidence->ny;
    const double limit = evidence->unsure * evidence->unsure;
    for (size_t cell = 0, wall = 0; cell < cells; cell++) {
        double sensitivity[DISPLACEMENTS];
        sensitivity_of(&registered->columns, evidence->response, cells, cell, &wall, sensitivity);
        const double error = displacement_variance(registration, sensitivity);
        clear[cell] = registered->seen[cell] && error + registered->misread[cell] < limit;
    }
}

bool is_displaced(const Registration *registration) {
    return registration->has_shift || registration->has_wide_spot;
}

void take_as_read(const ScanEvidence *evidence, RegisteredScan *registered) {
    registered->before = evidence->before;
    registered->scan = evidence->scan;
    registered->misread = NULL;
    registered->seen = registered->clear = evidence->valid;
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
static bool learn(const ScanEvidence *evidence, bool is_iterated, Room *room, double x[UNKNOWNS],
                  Registration *registration, RegisteredScan *registered) {
    const size_t cells = evidence->nx * evidence->ny;
    double covariance[UNKNOWNS * UNKNOWNS];
    if (is_iterated && !open_moved(room, cells))
        return false;
    if (!likeliest_displacement(evidence, registration, is_iterated, room, x, covariance) ||
        !update(x, covariance, registration, registered))
        return false;
    if (evidence->is_unknown)
        return true;
    learn_steps(registration, x, covariance);
    const LookSums sums = look_at_readings(evidence, room, is_iterated ? x[SPREAD] : 0.0);
    registration->far_product += sums.product;
    registration->far_information += sums.information;
    const double unclear = is_iterated ? fmax(1.0, unexplained(cells, room, registration->estimate)) : 1.0;
    decide(is_iterated, BEYOND_DOUBT * unclear, registration);
    learn_misfit(&sums, registration);
    return true;
}

/* A displacement that the linear step finds is to stand the iteration, else nothing is corrected. */
static bool learn_and_confirm(const ScanEvidence *evidence, Room *room, double x[UNKNOWNS], Registration *registration,
                              RegisteredScan *registered) {
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

bool register_scan(const ScanEvidence *evidence, Room *room, Registration *registration, RegisteredScan *registered) {
    const Registration before = *registration;
    double x[UNKNOWNS];
    if (!learn_and_confirm(evidence, room, x, registration, registered))
        return false; /* no memory, or singular to rounding: with the prior in them these equations never are */
    registered->columns = room->columns;
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        registration->applied[k] = is_applied(registration, k) ? registration->estimate[k] : 0.0;
    if (!is_displaced(registration)) {
        take_as_read(evidence, registered);
        return true;
    }
    correct_scan(evidence, registration, x, before.applied, room);
    registered->before = room->moved.before;
    registered->scan = room->moved.scan;
    registered->misread = room->moved.misread;
    registered->seen = room->moved.seen;
    registered->clear = room->moved.clear;
    mark_clear(evidence, registration, registered, room->moved.clear);
    return true;
}

double displacement_variance(const Registration *registration, const double response[DISPLACEMENTS]) {
    double sum = 0.0;
    for (size_t i = 0; i < DISPLACEMENTS; i++)
        for (size_t j = 0; j < DISPLACEMENTS; j++)
            sum += response[i] * registration->covariance[i * DISPLACEMENTS + j] * response[j];
    return sum;
}
