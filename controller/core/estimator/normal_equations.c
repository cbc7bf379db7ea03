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
    const double *displaced = room->moved.displaced_growth;
    for (size_t k = 0; k < count; k++)
        growth[k] =
            room->is_moved ? displaced[first + k] : evidence->predicted[first + k] - evidence->before[first + k];
}

/* Weight of a reading that a move leaves so far off, in standard deviations. */
static INLINED double robust_weight(double off, bool with_strange) {
    const double kept = off > OUTLIER ? OUTLIER / off : 1.0;
    return off > STRANGE && !with_strange ? 0.0 : kept;
}

/* Weights of some readings, of which a move leaves `left`; most blocks have no outlier, and need no root. */
static INLINED void robust_weights(size_t count, const double *left, const double *weights, bool with_strange,
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
static INLINED void take_walls(const Room *room, size_t first, size_t count, const double last[UNKNOWNS], size_t *wall,
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

static INLINED void add_wall(double weight, const double column[LANES], NormalSums *sums) {
    for (size_t i = 0; i < UNKNOWNS; i++) {
        const double weighted = weight * column[i];
        for (size_t j = 0; j < LANES; j++)
            sums->of[i][j] += weighted * column[j];
    }
}

/* Adds some cells: where there is no wall, growth is the only unknown. */
static INLINED void add_block(const Room *room, size_t first, size_t count, const double last[UNKNOWNS],
                              bool with_strange, size_t *wall, ReadingBlock *block, NormalSums *sums) {
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
    for (size_t k = 0; has_walls && k < count; k++)
        if (is_wall[k]) {
            add_wall(block->weight[k], block->at_wall[k], sums);
            product[k] = square[k] = 0.0;
        }
    own[REST] += lane_sum(product, count);
    own[GROWTH] += lane_sum(square, count);
}

/* What the threads share. */
typedef struct {
    const ScanEvidence *evidence;
    const Room *room;
    const double *last; /* move */
    bool with_strange;
    NormalSums sums[CHUNKS];
} Readings;

static INLINED void add_range(void *context, const RowRange *range) {
    Readings *work = context;
    const size_t nx = work->evidence->nx, ny = work->evidence->ny;
    size_t wall = work->room->columns.before[range->chunk];
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t end = chunk_row(nx, chunk + 1) * ny;
        NormalSums sums = {{{0.0}}};
        ReadingBlock block;
        for (size_t first = chunk_row(nx, chunk) * ny; first < end; first += BLOCK) {
            const size_t count = end - first < BLOCK ? end - first : BLOCK;
            take_growth(work->evidence, work->room, first, count, block.growth);
            add_block(work->room, first, count, work->last, work->with_strange, &wall, &block, &sums);
        }
        work->sums[chunk] = sums;
    }
}

CLONED_ROW_WORK(add_readings, add_range)

void add_normal_equations(const ScanEvidence *evidence, const Room *room, const double last[UNKNOWNS],
                          bool with_strange, double *matrix, double side[UNKNOWNS]) {
    Readings work = {evidence, room, last, with_strange, {{{{0.0}}}}};
    run_rows(room->threads, evidence->nx, evidence->ny, add_readings, &work);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        for (size_t i = 0; i < UNKNOWNS; i++) {
            side[i] += work.sums[chunk].of[i][REST];
            for (size_t j = 0; j <= i; j++)
                matrix[i * UNKNOWNS + j] += work.sums[chunk].of[i][j];
        }
    for (size_t i = 0; i < UNKNOWNS; i++)
        for (size_t j = i + 1; j < UNKNOWNS; j++)
            matrix[i * UNKNOWNS + j] = matrix[j * UNKNOWNS + i];
}
