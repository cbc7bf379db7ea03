#include "normal_equations.h"

#include <math.h>
#include <string.h>

/* Standard deviations from which on a reading has Huber's weights, and none: a dead nozzle is no displacement (by
 * trial). */
static const double OUTLIER = 3.0, STRANGE = 6.0;
static const double BELOW_OUTLIER = 2.999; /* whatever the rounding, a reading below is none */

/* How the readings of some cells go with the growth. */
static INLINED void take_growth(const ScanEvidence *evidence, const Room *room, size_t first, size_t count,
                                double *restrict growth) {
    const double *predicted = evidence->predicted + first, *before = evidence->before + first;
    if (room->is_moved) {
        memcpy(growth, room->moved.displaced_growth + first, count * sizeof *growth);
        return;
    }
    for (size_t k = 0; k < count; k++)
        growth[k] = predicted[k] - before[k];
}

/* Weight of a reading that a move leaves so far off, in standard deviations. */
static INLINED double robust_weight(double off, bool with_strange) {
    const double kept = off > OUTLIER ? OUTLIER / off : 1.0;
    return off > STRANGE && !with_strange ? 0.0 : kept;
}

/* Whether any of some readings, of which a move leaves `left`, is an outlier. */
static INLINED bool has_outliers(size_t count, const double *left, const double *weights) {
    uint64_t outliers = 0;
    for (size_t k = 0; k < count; k++)
        outliers += left[k] * left[k] * weights[k] > BELOW_OUTLIER * BELOW_OUTLIER;
    return outliers > 0;
}

/* Weights of these readings; most blocks have no outlier, and need no root. */
static INLINED void robust_weights(size_t count, const double *left, const double *weights, bool with_strange,
                                   double *restrict robust) {
    for (size_t k = 0; k < count; k++)
        robust[k] = weights[k];
    if (!has_outliers(count, left, weights))
        return;
    for (size_t k = 0; k < count; k++)
        robust[k] *= robust_weight(fabs(left[k]) * sqrt(weights[k]), with_strange);
}

/* The walls among some cells: how their readings go with the unknowns, what is left of them, and their weights; padded
 * with walls of no weight to whole lanes. */
typedef struct {
    size_t count;
    const double *column[UNKNOWNS];
    double columns[GROWTH][BLOCK + LANES]; /* of those that do not stand behind each other */
    double growth[BLOCK + LANES], rest[BLOCK + LANES], weight[BLOCK + LANES];
} Walls;

/* The values of walls, of which there are so many. */
static INLINED void take_at_walls(const uint8_t *is_wall, const double *values, size_t count, size_t walls,
                                  double *taken) {
    for (size_t k = 0, wall = 0; k < count; k++) {
        taken[wall] = values[k];
        wall += is_wall[k];
    }
    memset(taken + walls, 0, LANES * sizeof *taken);
}

/* `wall`: number of walls before these cells, carried on. */
static INLINED void take_walls(const Room *room, size_t first, size_t count, const double *growth, size_t *wall,
                               Walls *walls) {
    const uint8_t *is_wall = room->is_wall + first;
    const double *rest = room->rest + first, *weight = room->weight + first;
    size_t found = 0;
    for (size_t k = 0; k < count; k++) { /* no branch depends on a cell */
        walls->growth[found] = growth[k];
        walls->rest[found] = rest[k];
        walls->weight[found] = weight[k];
        found += is_wall[k];
    }
    memset(walls->growth + found, 0, LANES * sizeof(double));
    memset(walls->rest + found, 0, LANES * sizeof(double));
    memset(walls->weight + found, 0, LANES * sizeof(double));
    for (size_t i = 0; i < GROWTH; i++) {
        walls->column[i] = room->columns.is_packed ? room->columns.of[i] + *wall : walls->columns[i];
        if (!room->columns.is_packed)
            take_at_walls(is_wall, room->columns.of[i] + first, count, found, walls->columns[i]);
    }
    walls->column[GROWTH] = walls->growth;
    walls->count = (found + LANES - 1) / LANES * LANES;
    *wall += found;
}

/* What a move leaves of the readings of walls. */
static INLINED void take_left(const Walls *walls, const double move[UNKNOWNS], double *restrict left) {
    const double *const *c = walls->column, *rest = walls->rest;
    const double *c0 = c[0], *c1 = c[1], *c2 = c[2], *c3 = c[3], *c4 = c[4], *c5 = c[5];
    _Static_assert((int)UNKNOWNS == 6, "as many columns");
    for (size_t k = 0; k < walls->count; k++)
        left[k] = rest[k] - move[0] * c0[k] - move[1] * c1[k] - move[2] * c2[k] - move[3] * c3[k] - move[4] * c4[k] -
                  move[5] * c5[k];
}

/* What the threads share. */
typedef struct {
    const ScanEvidence *evidence;
    const Room *room;
    const double *move, *before; /* before: NULL: the equations are taken for the first time */
    bool with_strange;
    NormalSums sums[CHUNKS];
} Readings;

/* The weights by what is `left`, or how they differ from those by what was left `before`; false if they do not. */
static INLINED bool take_weights(const Readings *work, size_t count, const double *left, const double *before,
                                 const double *weights, double *restrict robust) {
    double known[BLOCK + LANES];
    if (work->before && !has_outliers(count, left, weights) && !has_outliers(count, before, weights))
        return false;
    robust_weights(count, left, weights, work->with_strange, robust);
    if (!work->before)
        return true;
    robust_weights(count, before, weights, work->with_strange, known);
    for (size_t k = 0; k < count; k++)
        robust[k] -= known[k];
    return true;
}

static INLINED void add_walls(const Readings *work, const Walls *walls, NormalSums *sums) {
    double left[BLOCK + LANES], before[BLOCK + LANES], robust[BLOCK + LANES], weighted[BLOCK + LANES];
    take_left(walls, work->move, left);
    if (work->before)
        take_left(walls, work->before, before);
    if (!take_weights(work, walls->count, left, before, walls->weight, robust))
        return;
    for (size_t i = 0; i < UNKNOWNS; i++) {
        const double *column = walls->column[i];
        for (size_t k = 0; k < walls->count; k++)
            weighted[k] = robust[k] * column[k];
        for (size_t j = 0; j <= i; j++)
            sums->of[i][j] += lane_dot(weighted, walls->column[j], walls->count);
        sums->of[i][REST] += lane_dot(weighted, walls->rest, walls->count);
    }
}

/* Adds cells that are no walls: growth is the only unknown there. */
static INLINED void add_others(const Readings *work, size_t first, size_t count, const double *growth,
                               NormalSums *sums) {
    const double *rest = work->room->rest + first, *weight = work->room->weight + first;
    const uint8_t *is_wall = work->room->is_wall + first;
    const double move = work->move[GROWTH], moved = work->before ? work->before[GROWTH] : 0.0;
    double left[BLOCK], before[BLOCK], counted[BLOCK], weighted[BLOCK];
    for (size_t k = 0; k < count; k++) {
        left[k] = rest[k] - move * growth[k];
        before[k] = rest[k] - moved * growth[k];
    }
    for (size_t k = 0; k < count; k++)
        counted[k] = is_wall[k] ? 0.0 : weight[k];
    if (!take_weights(work, count, left, before, counted, weighted))
        return;
    for (size_t k = 0; k < count; k++)
        weighted[k] *= growth[k];
    sums->of[GROWTH][REST] += lane_dot(weighted, rest, count);
    sums->of[GROWTH][GROWTH] += lane_dot(weighted, growth, count);
}

static INLINED void add_range(void *context, const RowRange *range) {
    Readings *work = context;
    const size_t nx = work->evidence->nx, ny = work->evidence->ny;
    size_t wall = work->room->columns.before[range->chunk];
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t end = chunk_row(nx, chunk + 1) * ny;
        NormalSums sums = {{{0.0}}};
        Walls walls;
        for (size_t first = chunk_row(nx, chunk) * ny; first < end; first += BLOCK) {
            const size_t count = end - first < BLOCK ? end - first : BLOCK;
            double growth[BLOCK];
            take_growth(work->evidence, work->room, first, count, growth);
            add_others(work, first, count, growth, &sums);
            if (!memchr(work->room->is_wall + first, 1, count))
                continue;
            take_walls(work->room, first, count, growth, &wall, &walls);
            add_walls(work, &walls, &sums);
        }
        work->sums[chunk] = sums;
    }
}

CLONED_ROW_WORK(add_readings, add_range)

void add_normal_equations(const ScanEvidence *evidence, const Room *room, const double move[UNKNOWNS],
                          const double before[UNKNOWNS], bool with_strange, NormalSums *sums) {
    Readings work = {evidence, room, move, before, with_strange, {{{{0.0}}}}};
    run_rows(room->threads, evidence->nx, evidence->ny, add_readings, &work);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        for (size_t i = 0; i < UNKNOWNS; i++)
            for (size_t j = 0; j <= UNKNOWNS; j++)
                sums->of[i][j] += work.sums[chunk].of[i][j];
}
