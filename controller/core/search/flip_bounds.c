#include "flip_bounds.h"

#include <math.h>
#include <string.h>

#include "map_memory.h"
#include "row_ranges.h"

/* share of the interaction of side neighbours: far above the rounding of bounds below MOST */
static const double SURE = 1e-3;
static const double MOST = 32.0; /* largest bound, in the same unit: more than all near cells reduce together */

/* Limits within which floats neither overflow nor underflow, and the lattice of heights is far below their rounding. */
static const double VOLUME_MIN = 1e-9;                 /* [m] */
static const double SLOPE_MIN = 1e-9, SLOPE_MAX = 1e9; /* metre for metre */

/* Largest change of the slope of a cell's cost. */
static double slope_change(const PlanSurface *surface) {
    double heaviest = surface->problem->weight ? 0.0 : 1.0;
    for (size_t cell = 0; surface->problem->weight && cell < surface->framed; cell++)
        heaviest = surface->weight[cell] > heaviest ? surface->weight[cell] : heaviest;
    return heaviest * (2.0 * surface->upward + (surface->ceiling ? surface->problem->ceiling_cost : 0.0));
}

/* Upper bound of the shares that two droplets so many rows and columns apart have in common [m]. */
static double common_shares(const Droplet *droplet, size_t rows, size_t columns) {
    const double side = droplet->spread[SIDE], corner = droplet->spread[CORNER], smaller = fmin(side, corner);
    switch (rows + columns) {
    case 1:
        return 2.0 * side + 4.0 * smaller;
    case 2:
        return rows == 1 ? 2.0 * side + 2.0 * corner : side + 2.0 * corner;
    case 3:
        return 2.0 * smaller;
    default:
        return corner;
    }
}

/* Whether bounds exist: for one step and one kind, where the cost alone counts and floats can represent the values. */
static bool is_useful(const PlanSurface *surface, double slope) {
    return surface->steps == 1 && surface->weighting.alpha == 1.0 && surface->problem->kinds == 1 &&
           surface->chance <= 1.0 && surface->droplet[1].volume >= VOLUME_MIN && slope >= SLOPE_MIN &&
           slope <= SLOPE_MAX && surface->upward <= SLOPE_MAX;
}

static size_t distance(size_t one, size_t other) {
    return one > other ? one - other : other - one;
}

bool flip_bounds_open(FlipBounds *bounds, const PlanSurface *surface) {
    const Droplet *droplet = &surface->droplet[1];
    const double slope = slope_change(surface);
    *bounds = (FlipBounds){.least = NULL};
    if (!is_useful(surface, slope))
        return true;
    for (size_t row = 0; row <= 2 * FLIP_REACH; row++)
        for (size_t column = 0; column <= 2 * FLIP_REACH; column++) {
            const size_t rows = distance(row, FLIP_REACH), columns = distance(column, FLIP_REACH);
            bounds->loss[rows][columns] = (float)(slope * common_shares(droplet, rows, columns));
            bounds->near_loss[row][column] = bounds->loss[rows][columns];
        }
    bounds->sure = (float)(SURE * (double)bounds->loss[0][1] + FLIP_ROUNDING * slope * droplet->volume);
    bounds->most = (float)MOST * bounds->loss[0][1];
    bounds->prices = flip_prices(surface, bounds->most);
    bounds->least = take_maps(surface->framed, sizeof(float));
    flip_bounds_clear(bounds, surface);
    return bounds->least != NULL;
}

void flip_bounds_close(FlipBounds *bounds) {
    give_maps(bounds->least);
    bounds->least = NULL;
}

void flip_bounds_clear(FlipBounds *bounds, const PlanSurface *surface) {
    if (bounds->least)
        copy_in_threads(surface->threads, bounds->least, NULL, surface->framed * sizeof(float)); /* NaN */
}

enum { CHUNK = 8 };      /* cells of a row that are read together, or none of them */
enum { ROWS_AHEAD = 3 }; /* rows by which prefetching leads reading (by trial) */

/* A request to read bounds: for moves of cells that are awake, unless their bounds exceed the limit. */
typedef struct {
    const uint8_t *awake;
    uint8_t move;
    float limit; /* [m] */
} Renewal;

static void read_cells(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count) {
    flip_costs_read(&bounds->prices, surface, cell, count, bounds->least + cell);
}

/* Marks the cells of a row on which the move may help. */
static INLINED void open_cells(const FlipBounds *bounds, size_t cell, size_t count, const Renewal *renewal,
                               uint8_t *restrict open) {
    const float *least = bounds->least + cell, limit = renewal->limit;
    const uint8_t *awake = renewal->awake + cell, move = renewal->move;
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const uint8_t own = awake[k] & move;
        open[k] = least[k] > limit ? 0 : own;
    }
}

/* Whether a move may help on two or more of the cells: then it is faster to read all (by trial). */
static INLINED bool are_several_open(const uint8_t *open, size_t count) {
    uint64_t cells = 0;
    memcpy(&cells, open, count);
    return (cells & (cells - 1)) != 0; /* more than one bit */
}

/* Reads a row of less than a chunk. */
static void renew_narrow(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                         const Renewal *renewal) {
    uint8_t open[TILE];
    open_cells(bounds, cell, count, renewal, open);
    if (are_several_open(open, count))
        read_cells(bounds, surface, cell, count);
}

static INLINED bool is_any_awake(const uint8_t *awake, size_t count, uint8_t move) {
    uint64_t any = 0, cells;
    for (size_t k = 0; k + CHUNK <= count; k += CHUNK) {
        memcpy(&cells, awake + k, CHUNK);
        any |= cells;
    }
    memcpy(&cells, awake + count - CHUNK, CHUNK);
    return ((any | cells) & move * UINT64_C(0x0101010101010101)) != 0;
}

/* Reads a row of at least a chunk; the rest behind the last whole chunk is read with the cells before it. */
static INLINED void renew_row(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                              const Renewal *renewal) {
    const size_t chunks = count / CHUNK;
    uint8_t open[TILE] = {0};
    if (!is_any_awake(renewal->awake + cell, count, renewal->move))
        return;
    open_cells(bounds, cell, count, renewal, open);
    unsigned useful = 0; /* a bit for each chunk */
    for (size_t k = 0; k < chunks; k++)
        useful |= (unsigned)are_several_open(open + k * CHUNK, CHUNK) << k;
    for (size_t first = 0, last; useful >> first; first = last) {
        while (!(useful >> first & 1))
            first++;
        for (last = first; useful >> last & 1;)
            last++;
        read_cells(bounds, surface, cell + first * CHUNK, (last - first) * CHUNK);
    }
    if (count > chunks * CHUNK && are_several_open(open + count - CHUNK, CHUNK))
        read_cells(bounds, surface, cell + count - CHUNK, CHUNK);
}

/* Prefetches the data for reading and trying the row's cells in a tile, if any of them are awake. */
static INLINED void prefetch_row(const FlipBounds *bounds, const PlanSurface *surface, size_t i, const Tile *tile,
                                 const Renewal *renewal) {
    const size_t cell = surface_cell(surface, i, tile->left), count = tile->right - tile->left;
    const double *maps[] = {surface_height(surface, 0), surface_height(surface, 1), surface->target, surface->weight,
                            surface->cost};
    if (i + ROWS_AHEAD < surface->nx)
        prefetch(renewal->awake + cell + ROWS_AHEAD * surface->stride, count);
    if (count < CHUNK || !is_any_awake(renewal->awake + cell, count, renewal->move))
        return;
    prefetch(bounds->least + cell, count * sizeof(float));
    prefetch(surface_layer(surface, 0) + cell, count);
    prefetch(surface->problem->choices + i * surface->ny + tile->left, count * sizeof(uint16_t));
    for (size_t k = 0; k < sizeof maps / sizeof *maps; k++)
        prefetch(maps[k] + cell, count * sizeof(double));
}

static INLINED void renew(const FlipBounds *bounds, const PlanSurface *surface, const Tile *tile,
                          const Renewal *renewal) {
    const size_t count = tile->right - tile->left;
    for (size_t i = tile->top; i < tile->bottom; i++) {
        const size_t cell = surface_cell(surface, i, tile->left);
        if (i + ROWS_AHEAD < surface->nx)
            prefetch_row(bounds, surface, i + ROWS_AHEAD, tile, renewal);
        if (count == TILE) /* a constant: whole vectors */
            renew_row(bounds, surface, cell, TILE, renewal);
        else if (count >= CHUNK)
            renew_row(bounds, surface, cell, count, renewal);
        else
            renew_narrow(bounds, surface, cell, count, renewal);
    }
}

static void renew_plain(const FlipBounds *bounds, const PlanSurface *surface, const Tile *tile,
                        const Renewal *renewal) {
    renew(bounds, surface, tile, renewal);
}

static WITH_AVX2 void renew_avx2(const FlipBounds *bounds, const PlanSurface *surface, const Tile *tile,
                                 const Renewal *renewal) {
    renew(bounds, surface, tile, renewal);
}

void flip_bounds_renew(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile, const uint8_t *awake,
                       uint8_t move) {
    if (!bounds->least)
        return;
    const Renewal renewal = {awake, move, bounds->sure + (move == MOVE_SWAPS ? bounds->loss[0][1] : 0.0f)};
    (HAS_AVX2 ? renew_avx2 : renew_plain)(bounds, surface, tile, &renewal);
}

/* Lower bounds of the cost of one droplet more on the cells of a row, with one more at either end; infinite where there
 * is a droplet. */
static INLINED void cost_to_jet(const FlipBounds *bounds, const uint8_t *plan, size_t cell, size_t count,
                                float *restrict least) {
    for (size_t k = 0; k < count + 2; k++) {
        const float bound = bounds->least[cell + k - 1];
        least[k] = plan[cell + k - 1] ? INFINITY : bound;
    }
}

/* Keeps open the cells whose droplet may be worth swapping with a neighbour that has none. */
static INLINED void close_swaps(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                                uint8_t *restrict open) {
    const uint8_t *plan = surface_layer(surface, 0);
    const float side = bounds->loss[0][1] + bounds->sure, corner = bounds->loss[1][1] + bounds->sure;
    float rows[3][TILE + 2];
    int32_t may_help[TILE];
    for (size_t row = 0; row < 3; row++)
        cost_to_jet(bounds, plan, cell + row * surface->stride - surface->stride, count, rows[row]);
    const float *above = rows[0], *here = rows[1], *below = rows[2];
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const float own = bounds->least[cell + k]; /* NaN may help */
        may_help[k] = !(own + above[k] > corner) | !(own + above[k + 1] > side) | !(own + above[k + 2] > corner) |
                      !(own + here[k] > side) | !(own + here[k + 2] > side) | !(own + below[k] > corner) |
                      !(own + below[k + 1] > side) | !(own + below[k + 2] > corner);
    }
    AS_LOOP for (size_t k = 0; k < count; k++) open[k] = plan[cell + k] && may_help[k] ? open[k] : 0;
}

static INLINED void mark_some(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                              const Renewal *renewal, uint8_t *restrict open) {
    open_cells(bounds, cell, count, renewal, open);
    if (renewal->move == MOVE_SWAPS)
        close_swaps(bounds, surface, cell, count, open);
}

static INLINED void mark_open(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                              const Renewal *renewal, uint8_t *restrict open) {
    if (count == TILE) /* a constant: whole vectors */
        mark_some(bounds, surface, cell, TILE, renewal, open);
    else
        mark_some(bounds, surface, cell, count, renewal, open);
}

static void mark_plain(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                       const Renewal *renewal, uint8_t *open) {
    mark_open(bounds, surface, cell, count, renewal, open);
}

static WITH_AVX2 void mark_avx2(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                                const Renewal *renewal, uint8_t *open) {
    mark_open(bounds, surface, cell, count, renewal, open);
}

void flip_bounds_mark(const FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                      const uint8_t *awake, uint8_t move, uint8_t *open) {
    const Renewal renewal = {awake, move, move == MOVE_SWAPS ? INFINITY : bounds->sure};
    if (bounds->least)
        (HAS_AVX2 ? mark_avx2 : mark_plain)(bounds, surface, cell, count, &renewal, open);
    for (size_t k = 0; !bounds->least && k < count; k++)
        open[k] = awake[cell + k] & move;
}

static INLINED uint32_t four_bytes(const uint8_t *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

/* Subtracts the loss of a change from the bounds of LOSS_LANES cells of a row where the plan now has the same value;
 * all numbers have one size, so that gcc vectorises the loop. */
static INLINED void lower_lanes(float *restrict least, const uint8_t *plan, unsigned value, const float *loss) {
    static const uint32_t SHIFT[LOSS_LANES] = {0, 8, 16, 24, 0, 8, 16, 24};
    const uint32_t half[2] = {four_bytes(plan), four_bytes(plan + 4)};
    uint32_t cells[LOSS_LANES];
    for (size_t k = 0; k < LOSS_LANES; k++)
        cells[k] = half[k / 4];
    AS_LOOP for (size_t k = 0; k < LOSS_LANES; k++) {
        const float lost = loss[k];
        least[k] -= (cells[k] >> SHIFT[k] & 1) == value ? lost : 0.0f;
    }
}

/* The same for some cells at an edge of the grid. */
static INLINED void lower_cells(float *least, const uint8_t *plan, size_t count, unsigned value, const float *loss) {
    for (size_t k = 0; k < count; k++)
        least[k] -= plan[k] == value ? loss[k] : 0.0f;
}

static INLINED void lower(FlipBounds *bounds, const PlanSurface *surface, size_t i, size_t j, unsigned value) {
    const size_t top = i > FLIP_REACH ? i - FLIP_REACH : 0, left = j > FLIP_REACH ? j - FLIP_REACH : 0;
    const size_t bottom = i + FLIP_REACH < surface->nx ? i + FLIP_REACH : surface->nx - 1;
    const size_t right = j + FLIP_REACH < surface->ny ? j + FLIP_REACH : surface->ny - 1;
    const bool is_inside = j >= FLIP_REACH && j - FLIP_REACH + LOSS_LANES <= surface->ny;
    for (size_t row = top; row <= bottom; row++) {
        const size_t cell = surface_cell(surface, row, left);
        const float *loss = bounds->near_loss[row + FLIP_REACH - i] + (left + FLIP_REACH - j);
        const uint8_t *plan = surface_layer(surface, 0) + cell;
        if (is_inside)
            lower_lanes(bounds->least + cell, plan, value, loss);
        else
            lower_cells(bounds->least + cell, plan, right - left + 1, value, loss);
    }
}

static void lower_plain(FlipBounds *bounds, const PlanSurface *surface, size_t i, size_t j, unsigned value) {
    lower(bounds, surface, i, j, value);
}

static WITH_AVX2 void lower_avx2(FlipBounds *bounds, const PlanSurface *surface, size_t i, size_t j, unsigned value) {
    lower(bounds, surface, i, j, value);
}

void flip_bounds_change(FlipBounds *bounds, const PlanSurface *surface, size_t i, size_t j, unsigned value,
                        double flip) {
    if (!bounds->least)
        return;
    (HAS_AVX2 ? lower_avx2 : lower_plain)(bounds, surface, i, j, value);
    flip_bounds_put(bounds, surface_cell(surface, i, j), flip);
}
