#include "scan_linearisation.h"

#include <math.h>
#include <string.h>

#include "map_memory.h"

/* Curvature of a wall in standard deviations: noise that a shift between cells averages is no evidence of one. */
static const double WALL = 4.0;

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
static INLINED void take_readings(const ScanEvidence *evidence, const double *readings, const double whole[SHIFTS],
                                  const Room *room, const RowRange *range) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    const ptrdiff_t down = (ptrdiff_t)whole[0], right = (ptrdiff_t)whole[1];
    const size_t from = right > 0 ? (size_t)right : 0, end = right < 0 ? ny - (size_t)-right : ny;
    for (size_t i = range->top; i < range->bottom; i++) {
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

/* Marks the walls of row i, and turns the weights of readings that count 1 into those by their variance. */
static INLINED void weigh_row(const ScanEvidence *evidence, double misfit, const Room *room, size_t i) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    const double noise = evidence->noise_variance;
    double *curved = room->curvature + i * ny, *restrict weight = room->weight + i * ny;
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

/* What the threads of one linearisation share. */
typedef struct {
    const ScanEvidence *evidence;
    Room *room;
    const double *readings; /* the scan that is expected [m] */
    const double *whole;    /* shift of whole cells */
    const DisplacedView *left;
    double misfit;
    size_t walls[CHUNKS]; /* of the rows of each chunk */
} Linearisation;

static INLINED void weigh_rows(void *context, const RowRange *range) {
    Linearisation *work = context;
    const size_t nx = work->evidence->nx, ny = work->evidence->ny;
    take_readings(work->evidence, work->readings, work->whole, work->room, range);
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t top = chunk_row(nx, chunk), bottom = chunk_row(nx, chunk + 1);
        size_t count = 0;
        for (size_t i = top; i < bottom; i++)
            weigh_row(work->evidence, work->misfit, work->room, i);
        for (size_t cell = top * ny; cell < bottom * ny; cell++)
            count += work->room->is_wall[cell];
        work->walls[chunk] = count;
    }
}

CLONED_ROW_WORK(weigh_readings, weigh_rows)

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
static void pack_columns(void *context, const RowRange *range) {
    const Linearisation *work = context;
    const Room *room = work->room;
    const size_t ny = work->evidence->ny;
    double *rows = room->strips + range->thread * STRIP_MAPS * STRIP * ny;
    size_t walls = room->columns.before[range->chunk];
    for (size_t top = range->top; top < range->bottom; top += STRIP_ROWS) {
        const size_t bottom = top + STRIP_ROWS < range->bottom ? top + STRIP_ROWS : range->bottom;
        const Scratch strip = {rows, top > STRIP_REACH ? top - STRIP_REACH : 0, STRIP};
        Rows columns[GROWTH];
        for (size_t k = 0; k < GROWTH; k++)
            columns[k] = scratch_map(&strip, ny, SCRATCH_MAPS + k);
        take_columns_of_rows(work->evidence, work->left, &strip, room, top, bottom, columns);
        for (size_t i = top; i < bottom; i++)
            walls = pack_row(room, ny, i, columns, walls);
    }
}

/* Room for the columns of the walls, and for whole lanes at their end. False if there is no memory. */
static bool open_columns(Room *room, size_t walls) {
    give_maps(room->packed);
    room->packed = take_raw_maps(walls * GROWTH + LANES, sizeof(double));
    if (!room->packed)
        return false;
    room->columns.is_packed = true;
    for (size_t k = 0; k < GROWTH; k++)
        room->columns.of[k] = room->packed + k * walls;
    memset(room->packed + GROWTH * walls, 0, LANES * sizeof(double));
    return true;
}

/* Of a scan that is displaced the columns stand in maps. */
static void map_columns(const ScanEvidence *evidence, const DisplacedView *left, Room *room) {
    const size_t nx = evidence->nx;
    const Scratch scratch = {room->moved.scratch, 0, nx};
    Rows columns[GROWTH];
    room->columns.is_packed = false;
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

/* The number of walls before each chunk. */
static void count_walls(const size_t walls[CHUNKS], Room *room) {
    room->columns = (WallColumns){.is_wall = room->is_wall};
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        room->columns.before[chunk + 1] = room->columns.before[chunk] + walls[chunk];
}

bool linearise(const ScanEvidence *evidence, const double applied[DISPLACEMENTS], double misfit,
               const double x[UNKNOWNS], Room *room) {
    const size_t nx = evidence->nx, ny = evidence->ny;
    const Patch grid = {0, nx, 0, ny};
    double moved[DISPLACEMENTS], now[DISPLACEMENTS], whole[SHIFTS];
    displacement_now(x, now);
    const Displacement left = split_displacement(now, whole);
    const DisplacedView view = displaced_view(left);
    Linearisation work = {.evidence = evidence, .room = room, .whole = whole, .left = &view, .misfit = misfit};
    room->is_moved = left.x != 0.0 || left.y != 0.0 || view.spot.reach > 0;
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        moved[k] = x[k] - applied[k];
    room->surface = work.readings = surface_at(evidence, moved, x[GROWTH], room);
    if (room->is_moved) {
        const Scratch scratch = {room->moved.scratch, 0, nx};
        const Rows displaced = scratch_map(&scratch, ny, SCRATCH_MAPS - 1);
        for (size_t cell = 0; cell < nx * ny; cell++)
            room->moved.growth[cell] = evidence->predicted[cell] - evidence->before[cell];
        displaced_scan(nx, ny, room->moved.growth, &view, &grid, &scratch, (Rows){room->moved.displaced_growth, 0});
        displaced_scan(nx, ny, room->surface, &view, &grid, &scratch, displaced);
        work.readings = displaced.values;
    }
    run_rows(room->threads, nx, ny, weigh_readings, &work);
    count_walls(work.walls, room);
    if (room->is_moved) {
        map_columns(evidence, &view, room);
        return true;
    }
    if (!open_columns(room, room->columns.before[CHUNKS]))
        return false;
    run_rows(room->threads, nx, ny, pack_columns, &work);
    return true;
}

bool open_moved(Room *room, size_t cells) {
    enum { OTHER_MAPS = GROWTH + 6 };
    if (room->moved.memory)
        return true;
    double *next = take_raw_maps(cells, (SCRATCH_MAPS + OTHER_MAPS) * sizeof(double) + 2);
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
