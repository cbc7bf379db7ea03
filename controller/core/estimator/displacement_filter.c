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
static const double BELOW_OUTLIER = 2.999; /* whatever the rounding, a reading below is none */
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

static bool has_wall(const Room *room, size_t ny, const Patch *patch) {
    for (size_t i = patch->top; i < patch->bottom; i++)
        if (memchr(room->is_wall + i * ny + patch->left, 1, patch->right - patch->left))
            return true;
    return false;
}

/* Takes the columns of some rows where there are walls, together with those of cells next to them. */
static void take_columns_of_rows(const ScanEvidence *evidence, const DisplacedView *left, const Scratch *scratch,
                                 const Room *room, size_t top, size_t bottom, const Rows columns[GROWTH]) {
    const size_t ny = evidence->ny;
    for (size_t j = 0; j < ny; j += BLOCK) {
        const Patch patch = {top, bottom, j, j + BLOCK < ny ? j + BLOCK : ny};
        if (has_wall(room, ny, &patch))
            take_columns(evidence, left, &patch, scratch, room, columns, columns + STEP);
    }
}

/* The columns of the walls of row i behind those of the walls before; their number, too. */
static size_t pack_row(const Room *room, size_t ny, size_t i, const Rows columns[GROWTH], size_t walls) {
    for (size_t j = next_wall(room, ny, i, 0), end; j < ny; j = next_wall(room, ny, i, end)) {
        for (end = j + 1; end < ny && room->is_wall[i * ny + end];)
            end++;
        for (size_t k = 0; k < GROWTH; k++)
            memcpy(room->columns.of[k] + walls, row_of(columns[k], ny, i) + j, (end - j) * sizeof(double));
        walls += end - j;
        if (end == ny)
            break;
    }
    return walls;
}

/* The columns of walls alone: those of a few rows at a time stand in maps. */
static void pack_columns(const ScanEvidence *evidence, const DisplacedView *left, Room *room) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    size_t walls = 0;
    for (size_t top = 0; top < nx; top += STRIP_ROWS) {
        const size_t bottom = top + STRIP_ROWS < nx ? top + STRIP_ROWS : nx;
        const Scratch strip = {room->strip, top > STRIP_REACH ? top - STRIP_REACH : 0, STRIP};
        Rows columns[GROWTH];
        for (size_t k = 0; k < GROWTH; k++)
            columns[k] = scratch_map(&strip, ny, SCRATCH_MAPS + k);
        take_columns_of_rows(evidence, left, &strip, room, top, bottom, columns);
        for (size_t i = top; i < bottom; i++)
            walls = pack_row(room, ny, i, columns, walls);
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

/* Of a scan that is displaced the columns stand in maps. */
static void map_columns(const ScanEvidence *evidence, const DisplacedView *left, Room *room) {
    const size_t nx = evidence->nx;
    const Scratch scratch = {room->moved.scratch, 0, nx};
    Rows columns[GROWTH];
    room->columns = (WallColumns){.is_wall = room->is_wall};
    for (size_t k = 0; k < GROWTH; k++)
        columns[k] = (Rows){room->columns.of[k] = room->moved.columns[k], 0};
    for (size_t top = 0; top < nx; top += BLOCK)
        take_columns_of_rows(evidence, left, &scratch, room, top, top + BLOCK < nx ? top + BLOCK : nx, columns);
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
    (room->is_moved ? map_columns : pack_columns)(evidence, &view, room);
    return true;
}

/* How the readings of some cells go with the growth. */
static void take_growth(const ScanEvidence *evidence, const Room *room, size_t first, size_t count,
                        double *restrict growth) {
    const double *displaced = room->moved.displaced_growth;
    for (size_t k = 0; k < count; k++)
        growth[k] = room->is_moved ? displaced[first + k] : evidence->predicted[first + k] - evidence->before[first + k];
}

/* Weight of a reading that a move leaves so far off, in standard deviations. */
static double robust_weight(double off, bool with_strange) {
    const double kept = off > OUTLIER ? OUTLIER / off : 1.0;
    return off > STRANGE && !with_strange ? 0.0 : kept;
}

/* Weights of some readings, of which a move leaves `left`; most blocks have no outlier, and need no root. */
static void robust_weights(size_t count, const double *left, const double *weights, bool with_strange,
                           double *restrict robust) {
    size_t outliers = 0;
    for (size_t k = 0; k < count; k++)
        outliers += left[k] * left[k] * weights[k] > BELOW_OUTLIER * BELOW_OUTLIER;
    for (size_t k = 0; k < count; k++)
        robust[k] = weights[k];
    for (size_t k = 0; outliers > 0 && k < count; k++)
        robust[k] *= robust_weight(fabs(left[k]) * sqrt(weights[k]), with_strange);
}

enum { REST = UNKNOWNS, LANES = 8 };

/* The normal equations by their lower triangle and, in lane REST, their right side. */
typedef struct {
    double of[UNKNOWNS][LANES];
} NormalSums;

/* How the readings of some cells go with the unknowns, and what is left of them: first the move, later that. */
typedef struct {
    double growth[BLOCK], left[BLOCK], weight[BLOCK], at_wall[BLOCK][LANES];
} ReadingBlock;

/* Takes the columns of the walls among some cells, and what the move `last` leaves there. */
static void take_walls(const Room *room, size_t first, size_t count, const double last[UNKNOWNS], size_t *wall,
                       ReadingBlock *block) {
    for (size_t k = 0; k < count; k++) {
        const size_t place = column_place(&room->columns, first + k, wall);
        double *column = block->at_wall[k], left = room->rest[first + k];
        if (!room->is_wall[first + k])
            continue;
        for (size_t i = 0; i < GROWTH; i++)
            column[i] = room->columns.of[i][place];
        column[GROWTH] = block->growth[k];
        column[REST] = left;
        column[REST + 1] = 0.0;
        for (size_t i = 0; i < UNKNOWNS; i++)
            left -= last[i] * column[i];
        block->left[k] = left;
    }
}

static void add_wall(double weight, const double column[LANES], NormalSums *sums) {
    for (size_t i = 0; i < UNKNOWNS; i++) {
        const double weighted = weight * column[i];
        for (size_t j = 0; j < LANES; j++)
            sums->of[i][j] += weighted * column[j];
    }
}

/* Adds some cells: where there is no wall, growth is the only unknown. */
static void add_block(const Room *room, size_t first, size_t count, const double last[UNKNOWNS], bool with_strange,
                      size_t *wall, ReadingBlock *block, NormalSums *sums) {
    const double *rest = room->rest + first, *growth = block->growth;
    const uint8_t *is_wall = room->is_wall + first;
    const bool has_walls = memchr(is_wall, 1, count);
    double product[BLOCK], square[BLOCK], *own = sums->of[GROWTH];
    for (size_t k = 0; k < count; k++)
        block->left[k] = rest[k] - last[GROWTH] * growth[k];
    if (has_walls)
        take_walls(room, first, count, last, wall, block);
    robust_weights(count, block->left, room->weight + first, with_strange, block->weight);
    for (size_t k = 0; k < count; k++) {
        const double weighted = block->weight[k] * growth[k];
        product[k] = weighted * rest[k];
        square[k] = weighted * growth[k];
    }
    for (size_t k = 0; k < count; k++) {
        if (has_walls && is_wall[k]) {
            add_wall(block->weight[k], block->at_wall[k], sums);
            continue;
        }
        own[REST] += product[k];
        own[GROWTH] += square[k];
    }
}

/* Adds the readings to the normal equations of a move, with robust weights after the move `last`. */
static void normal_equations(const ScanEvidence *evidence, const Room *room, const double last[UNKNOWNS],
                             bool with_strange, double *matrix, double side[UNKNOWNS]) {
    const size_t cells = evidence->nx * evidence->ny;
    NormalSums sums = {{{0.0}}};
    ReadingBlock block;
    size_t wall = 0;
    for (size_t i = 0; i < UNKNOWNS; i++) {
        memcpy(sums.of[i], matrix + i * UNKNOWNS, UNKNOWNS * sizeof *matrix);
        sums.of[i][REST] = side[i];
    }
    for (size_t first = 0; first < cells; first += BLOCK) {
        const size_t count = cells - first < BLOCK ? cells - first : BLOCK;
        take_growth(evidence, room, first, count, block.growth);
        add_block(room, first, count, last, with_strange, &wall, &block, &sums);
    }
    for (size_t i = 0; i < UNKNOWNS; i++) {
        side[i] = sums.of[i][REST];
        for (size_t j = 0; j < UNKNOWNS; j++)
            matrix[i * UNKNOWNS + j] = j > i ? sums.of[j][i] : sums.of[i][j];
    }
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
