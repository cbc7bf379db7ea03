#include "displacement_filter.h"

#include <math.h>
#include <string.h>

#include "map_memory.h"
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

static double within(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

void curvature_of_row(size_t nx, size_t ny, const double *height, size_t i, double *curvature) {
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
    const double *before = evidence->before, *predicted = evidence->predicted;
    for (size_t cell = 0; cell < cells; cell++)
        surface[cell] = predicted[cell] + growth * (predicted[cell] - before[cell]);
    for (size_t k = 0; k < DISPLACEMENTS; k++) {
        const double *response = evidence->response + k * cells, move = moved[k];
        for (size_t cell = 0; move != 0.0 && cell < cells; cell++)
            surface[cell] += move * response[cell];
    }
}

void displacement_now(const double x[UNKNOWNS], double now[DISPLACEMENTS]) {
    memcpy(now, x, DISPLACEMENTS * sizeof *now);
    for (size_t k = 0; k < SHIFTS; k++)
        now[k] += x[STEP + k];
}

/* What is left of each reading, and its weight without that of outliers. */
static void take_readings(const ScanEvidence *evidence, const double *readings, const double whole[SHIFTS],
                          const Room *room) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    const ptrdiff_t down = (ptrdiff_t)whole[0], right = (ptrdiff_t)whole[1];
    const size_t from = right > 0 ? (size_t)right : 0, end = right < 0 ? ny - (size_t)-right : ny;
    for (size_t i = 0; i < nx; i++) {
        const ptrdiff_t scanned = (ptrdiff_t)i - down;
        double *restrict rest = room->rest + i * ny, *restrict weight = room->weight + i * ny;
        const double *reading = readings + i * ny;
        size_t j = 0;
        if (scanned >= 0 && scanned < (ptrdiff_t)nx && right > -(ptrdiff_t)ny && right < (ptrdiff_t)ny) {
            for (; j < from; j++)
                rest[j] = weight[j] = 0.0;
            const double *scan = evidence->scan + scanned * (ptrdiff_t)ny - right;
            const uint8_t *valid = evidence->valid + scanned * (ptrdiff_t)ny - right;
            for (; j < end; j++) {
                rest[j] = valid[j] ? scan[j] - reading[j] : 0.0;
                weight[j] = valid[j] ? 1.0 : 0.0;
            }
        }
        for (; j < ny; j++)
            rest[j] = weight[j] = 0.0;
    }
}

/* Marks the walls, and turns the weights of readings that count 1 into those by their variance. */
static void weigh_readings(const ScanEvidence *evidence, const Registration *registration, Room *room) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    const double misfit = registration->misfit;
    for (size_t i = 0; i < nx; i++) {
        double *curved = room->curvature + i * ny, *restrict weight = room->weight + i * ny;
        const double noise = evidence->noise_variance;
        uint8_t *restrict is_wall = room->is_wall + i * ny;
        double sure[BLOCK];
        curvature_of_row(nx, ny, room->surface, i, curved);
        for (size_t first = 0; first < ny; first += BLOCK) {
            const size_t count = ny - first < BLOCK ? ny - first : BLOCK;
            predicted_variance(&evidence->variance, i * ny + first, count, sure);
            for (size_t k = 0; k < count; k++)
                sure[k] = sure[k] + noise + READING_STD * READING_STD;
            for (size_t k = 0; k < count; k++) {
                const double curvature = curved[first + k], variance = sure[k] + misfit * curvature * curvature;
                weight[first + k] = weight[first + k] == 0.0 ? 0.0 : 1.0 / variance;
            }
            for (size_t k = 0; k < count; k++)
                is_wall[first + k] = curved[first + k] * curved[first + k] > WALL * WALL * sure[k];
        }
    }
}

/* The columns of the displacement in a patch. */
static void take_columns(const ScanEvidence *evidence, const DisplacedView *left, const Patch *patch,
                         const Scratch *scratch, const Room *room, const Rows columns[DISPLACEMENTS],
                         const Rows steps[SHIFTS]) {
    const size_t nx = evidence->nx, ny = evidence->ny, cells = nx * ny;
    const Rows moved = scratch_map(scratch, ny, SCRATCH_MAPS - 1);
    displaced_scan_slopes(nx, ny, room->surface, left, patch, scratch, columns);
    for (size_t k = 0; k < DISPLACEMENTS; k++) {
        displaced_scan(nx, ny, evidence->response + k * cells, left, patch, scratch, moved);
        for (size_t i = patch->top; i < patch->bottom; i++) {
            double *own = row_of(columns[k], ny, i), *step = k < SHIFTS ? row_of(steps[k], ny, i) : NULL;
            const double *row = row_of(moved, ny, i);
            for (size_t j = patch->left; j < patch->right; j++) {
                if (step)
                    step[j] = own[j];
                own[j] += row[j];
            }
        }
    }
}

/* The first wall of a row from column `from` on; ny if there is none. */
static size_t next_wall(const Room *room, size_t ny, size_t i, size_t from) {
    const uint8_t *row = room->is_wall + i * ny, *found = memchr(row + from, 1, ny - from);
    return found ? (size_t)(found - row) : ny;
}

/* Walls one after the other: what is read about them is little while the scan is not displaced. */
static void take_columns_of_walls(const ScanEvidence *evidence, const DisplacedView *left, Room *room) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    size_t wall = 0;
    for (size_t i = 0; i < nx; i++) {
        const size_t top = i > STRIP_REACH ? i - STRIP_REACH : 0;
        const Scratch strip = {room->strip, top, STRIP};
        Rows rows[GROWTH];
        for (size_t k = 0; k < GROWTH; k++)
            rows[k] = scratch_map(&strip, ny, SCRATCH_MAPS + k);
        for (size_t j = next_wall(room, ny, i, 0), end; j < ny; j = next_wall(room, ny, i, end)) {
            for (end = j + 1; end < ny && room->is_wall[i * ny + end];)
                end++;
            const Patch run = {i, i + 1, j, end};
            take_columns(evidence, left, &run, &strip, room, rows, rows + STEP);
            for (size_t k = 0; k < GROWTH; k++)
                memcpy(room->columns.of[k] + wall, row_of(rows[k], ny, i) + j, (end - j) * sizeof(double));
            wall += end - j;
            if (end == ny)
                break;
        }
    }
}

/* Room for the columns of the walls. False if there is no memory. */
static bool open_columns(Room *room, size_t cells) {
    size_t walls = 0;
    for (size_t cell = 0; cell < cells; cell++)
        walls += room->is_wall[cell];
    give_maps(room->packed);
    room->packed = take_maps(walls, GROWTH * sizeof(double));
    if (!room->packed)
        return false;
    room->columns = (WallColumns){.is_wall = room->is_wall, .is_packed = true};
    for (size_t k = 0; k < GROWTH; k++)
        room->columns.of[k] = room->packed + k * walls;
    return true;
}

static bool has_wall(const Room *room, size_t ny, const Patch *patch) {
    for (size_t i = patch->top; i < patch->bottom; i++)
        if (memchr(room->is_wall + i * ny + patch->left, 1, patch->right - patch->left))
            return true;
    return false;
}

/* Walls together with their surroundings, which overlap. */
static void take_columns_of_patches(const ScanEvidence *evidence, const DisplacedView *left, Room *room) {
    enum { SIDE = 32 };
    const size_t nx = evidence->nx, ny = evidence->ny;
    const Scratch scratch = {room->moved.scratch, 0, nx};
    Rows maps[GROWTH];
    room->columns = (WallColumns){.is_wall = room->is_wall};
    for (size_t k = 0; k < GROWTH; k++)
        maps[k] = (Rows){room->columns.of[k] = room->moved.columns[k], 0};
    for (size_t i = 0; i < nx; i += SIDE)
        for (size_t j = 0; j < ny; j += SIDE) {
            const Patch patch = {i, i + SIDE < nx ? i + SIDE : nx, j, j + SIDE < ny ? j + SIDE : ny};
            if (has_wall(room, ny, &patch))
                take_columns(evidence, left, &patch, &scratch, room, maps, maps + STEP);
        }
}

/* Where the scan is linearised: the prediction itself if nothing moves it. */
static const double *surface_at(const ScanEvidence *evidence, const double moved[DISPLACEMENTS], double growth,
                                const Room *room) {
    bool is_predicted = growth == 0.0;
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        is_predicted = is_predicted && moved[k] == 0.0;
    if (is_predicted)
        return evidence->predicted;
    surface_by(evidence, moved, growth, room->moved.surface);
    return room->moved.surface;
}

/* The scan linearised about `x`: columns, what is left of each reading, and its weight without that of outliers. False
 * if there is no memory. */
static bool linearise(const ScanEvidence *evidence, const Registration *registration, const double x[UNKNOWNS],
                      Room *room) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    const Patch grid = {0, nx, 0, ny};
    double moved[DISPLACEMENTS], now[DISPLACEMENTS], whole[SHIFTS];
    displacement_now(x, now);
    const Displacement left = split_displacement(now, whole);
    const DisplacedView view = displaced_view(left);
    room->is_moved = left.x != 0.0 || left.y != 0.0 || view.spot.reach > 0;
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        moved[k] = x[k] - registration->applied[k];
    room->surface = surface_at(evidence, moved, x[GROWTH], room);
    const double *reading = room->surface;
    if (room->is_moved) {
        const Scratch scratch = {room->moved.scratch, 0, nx};
        const Rows displaced = scratch_map(&scratch, ny, SCRATCH_MAPS - 1);
        for (size_t cell = 0; cell < nx * ny; cell++)
            room->moved.growth[cell] = evidence->predicted[cell] - evidence->before[cell];
        displaced_scan(nx, ny, room->moved.growth, &view, &grid, &scratch, (Rows){room->moved.displaced_growth, 0});
        displaced_scan(nx, ny, room->surface, &view, &grid, &scratch, displaced);
        reading = displaced.values;
    }
    take_readings(evidence, reading, whole, room);
    weigh_readings(evidence, registration, room);
    if (!room->is_moved && !open_columns(room, nx * ny))
        return false;
    (room->is_moved ? take_columns_of_patches : take_columns_of_walls)(evidence, &view, room);
    return true;
}

/* How the readings of some cells go with the growth: in a map, or in `values`. */
static const double *growth_column(const ScanEvidence *evidence, const Room *room, size_t first, size_t count,
                                   double *restrict values) {
    if (room->is_moved)
        return room->moved.displaced_growth + first;
    for (size_t k = 0; k < count; k++)
        values[k] = evidence->predicted[first + k] - evidence->before[first + k];
    return values;
}

/* How the reading of a cell goes with the unknowns; returns the first one that it goes with. */
static size_t columns_of_cell(const Room *room, size_t cell, double growth, size_t *wall, double column[UNKNOWNS]) {
    const size_t place = column_place(&room->columns, cell, wall);
    column[GROWTH] = growth;
    if (!room->is_wall[cell])
        return GROWTH;
    for (size_t k = 0; k < GROWTH; k++)
        column[k] = room->columns.of[k][place];
    return 0;
}

/* Weight of a reading that a move leaves so far off, in standard deviations. */
static double robust_weight(double off, bool with_strange) {
    const double kept = off > OUTLIER ? OUTLIER / off : 1.0;
    return off > STRANGE && !with_strange ? 0.0 : kept;
}

/* Adds a cell to the normal equations, with a robust weight after the move `last`. */
static void add_cell(const Room *room, size_t cell, double growth, const double last[UNKNOWNS], bool with_strange,
                     size_t *wall, double *matrix, double side[UNKNOWNS]) {
    double column[UNKNOWNS], left = room->rest[cell];
    const size_t begin = columns_of_cell(room, cell, growth, wall, column);
    for (size_t k = begin; k < UNKNOWNS; k++)
        left -= last[k] * column[k];
    const double off = fabs(left) * sqrt(room->weight[cell]);
    const double weight = room->weight[cell] * robust_weight(off, with_strange);
    for (size_t i = begin; i < UNKNOWNS; i++) {
        const double weighted = weight * column[i];
        side[i] += weighted * room->rest[cell];
        for (size_t j = begin; j <= i; j++)
            matrix[i * UNKNOWNS + j] += weighted * column[j];
    }
}

/* Adds cells that no displacement moves: their growth is the only unknown. */
static void add_block(const Room *room, size_t first, size_t count, const double *growth, double move,
                      bool with_strange, double *matrix, double *side) {
    const double *rest = room->rest + first, *weights = room->weight + first;
    double off[BLOCK], product[BLOCK], square[BLOCK];
    for (size_t k = 0; k < count; k++)
        off[k] = fabs(rest[k] - move * growth[k]) * sqrt(weights[k]);
    for (size_t k = 0; k < count; k++) {
        const double weighted = weights[k] * robust_weight(off[k], with_strange) * growth[k];
        product[k] = weighted * rest[k];
        square[k] = weighted * growth[k];
    }
    for (size_t k = 0; k < count; k++) {
        *side += product[k];
        *matrix += square[k];
    }
}

/* The normal equations of a move with robust weights after the move `last`. */
static void normal_equations(const ScanEvidence *evidence, const Room *room, const double last[UNKNOWNS],
                             bool with_strange, double *matrix, double side[UNKNOWNS]) {
    const size_t cells = evidence->nx * evidence->ny;
    double values[BLOCK];
    size_t wall = 0;
    for (size_t first = 0; first < cells; first += BLOCK) {
        const size_t count = cells - first < BLOCK ? cells - first : BLOCK;
        const double *growth = growth_column(evidence, room, first, count, values);
        if (!memchr(room->is_wall + first, 1, count)) {
            add_block(room, first, count, growth, last[GROWTH], with_strange, &matrix[GROWTH * UNKNOWNS + GROWTH],
                      &side[GROWTH]);
            continue;
        }
        for (size_t k = 0; k < count; k++)
            add_cell(room, first + k, growth[k], last, with_strange, &wall, matrix, side);
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
                            Room *room, double x[UNKNOWNS], double *covariance) {
    double precision[UNKNOWNS * UNKNOWNS], matrix[UNKNOWNS * UNKNOWNS], before[UNKNOWNS] = {0.0};
    if (!prior_precision(evidence, registration, precision))
        return false;
    memcpy(before, registration->estimate, DISPLACEMENTS * sizeof *before);
    memcpy(x, before, sizeof before);
    if (!is_iterated)
        memcpy(x, registration->applied, sizeof registration->applied);
    const int rounds = evidence->is_unknown ? 0 : is_iterated ? ROUNDS : 1;
    memcpy(matrix, precision, sizeof matrix);
    if (!linearise(evidence, registration, x, room))
        return false;
    for (int round = 0; round < rounds; round++) {
        double move[UNKNOWNS] = {0.0}, largest = 0.0;
        if (round > 0 && !linearise(evidence, registration, x, room))
            return false;
        for (int weighing = 0; weighing < REWEIGHTINGS; weighing++) {
            double side[UNKNOWNS] = {0.0};
            memcpy(matrix, precision, sizeof matrix);
            for (size_t i = 0; i < UNKNOWNS; i++)
                for (size_t j = 0; j < UNKNOWNS; j++)
                    side[i] += precision[i * UNKNOWNS + j] * (before[j] - x[j]);
            normal_equations(evidence, room, move, round < ROUNDS_WITH_OUTLIERS, matrix, side);
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
    if (evidence->is_unknown)
        memcpy(x, before, sizeof before); /* nothing is learnt, nothing forgotten */
    return invert_definite(UNKNOWNS, matrix, covariance);
}

bool open_moved(Room *room, size_t cells) {
    enum { OTHER_MAPS = GROWTH + 6 };
    if (room->moved.memory)
        return true;
    double *next = take_maps(cells, (SCRATCH_MAPS + OTHER_MAPS) * sizeof(double) + 2);
    if (!next)
        return false;
    room->moved = (MovedMaps){.memory = next, .scratch = next};
    next += SCRATCH_MAPS * cells;
    double **single[] = {&room->moved.surface, &room->moved.growth, &room->moved.displaced_growth,
                         &room->moved.before,  &room->moved.scan,   &room->moved.misread};
    for (size_t k = 0; k < sizeof single / sizeof *single; k++, next += cells)
        *single[k] = next;
    for (size_t k = 0; k < GROWTH; k++, next += cells)
        room->moved.columns[k] = next;
    room->moved.seen = (uint8_t *)next;
    room->moved.clear = room->moved.seen + cells;
    return true;
}

void close_room(Room *room) {
    give_maps(room->moved.memory);
    give_maps(room->packed);
}
