#include "flip_bounds.h"

#include <string.h>

#include "instruction_sets.h"
#include "map_memory.h"

static const double SURE = 1e-3; /* of what a neighbour changes: far above the rounding of bounds below MOST */
static const double MOST = 32.0; /* of the same: more than all cells near take away together */

/* The steepest that the slope of a cell's cost can change by. */
static double slope_change(const PlanSurface *surface) {
    double heaviest = surface->problem->weight ? 0.0 : 1.0;
    for (size_t cell = 0; surface->problem->weight && cell < surface->framed; cell++)
        heaviest = surface->weight[cell] > heaviest ? surface->weight[cell] : heaviest;
    return heaviest * (2.0 * surface->upward + (surface->ceiling ? surface->problem->ceiling_cost : 0.0));
}

/* Shares that droplets so many rows and columns apart have in common, at most [m]. */
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

bool flip_bounds_open(FlipBounds *bounds, const PlanSurface *surface) {
    const bool is_useful = surface->steps == 1 && surface->weighting.alpha == 1.0 && surface->problem->kinds == 1 &&
                           surface->chance <= 1.0;
    *bounds = (FlipBounds){.least = NULL};
    if (!is_useful)
        return true;
    const Droplet *droplet = &surface->droplet[1];
    const double slope = slope_change(surface);
    for (size_t rows = 0; rows <= FLIP_REACH; rows++)
        for (size_t columns = 0; columns <= FLIP_REACH; columns++)
            bounds->loss[rows][columns] = (float)(slope * common_shares(droplet, rows, columns));
    bounds->sure = (float)SURE * bounds->loss[0][1];
    bounds->most = (float)MOST * bounds->loss[0][1];
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
        memset(bounds->least, UINT8_MAX, surface->framed * sizeof(float)); /* NaN */
}

enum { CHUNK = 8 };      /* cells of a row that are read together, or not at all */
enum { LEAST_OPEN = 2 }; /* where a move may help on so many of them, it takes less time to read all (by trial) */

/* What bounds are read for: moves of cells that are awake for them, unless their bounds are above the limit. */
typedef struct {
    const uint8_t *awake;
    uint8_t move;
    float limit; /* [m] */
} Renewal;

/* What counts in a cost, besides the error: constants wherever a function is inlined. */
typedef struct {
    bool chance, ceiling;
} Counted;

/* What the height of a cell after the step costs [m]: surface_cost, without a branch. */
static INLINED double cost_of(const PlanSurface *surface, size_t cell, double height, double chance,
                              const Counted counted) {
    const double error = height - surface->target[cell], size = fabs(error);
    const double safe = counted.chance && chance > 0.0 ? chance : 1.0, near = 0.5 * (size * size / safe + chance);
    const double expected = counted.chance && size < chance ? near : size;
    const double above = counted.ceiling ? height - surface->ceiling[cell] : 0.0;
    const double ceiling = counted.ceiling ? surface->problem->ceiling_cost * (above > 0.0 ? above : 0.0) : 0.0;
    return surface->weight[cell] * (surface->upward * expected + surface->skew * error + ceiling);
}

/* Flips of cells of a row: what is left of each droplet, +1 where it comes or -1 where it goes, and what that costs. */
typedef struct {
    double kept[TILE], sign[TILE], cost[TILE];
} FlipRow;

/* What a flip does to the cost of a neighbour that gets or loses this share. */
static INLINED double neighbour_cost(const PlanSurface *surface, size_t its, double change, const Counted counted) {
    const double chance = counted.chance ? surface->left_to_chance[its] : 0.0;
    return cost_of(surface, its, surface_height(surface, 1)[its] + change, chance, counted) - surface->cost[its];
}

/* Adds what the flips from `cell` on do to their neighbours in the row above or below, whose cells begin at `its`. */
static INLINED void add_row(const PlanSurface *surface, size_t cell, size_t its, size_t count, const Counted counted,
                            FlipRow *flips) {
    const Droplet *droplet = &surface->droplet[1];
    const double side = droplet->spread[SIDE], corner = droplet->spread[CORNER];
    const double side_slope = droplet->slope[SIDE], corner_slope = droplet->slope[CORNER];
    const double *here = surface_height(surface, 0) + cell, *there = surface_height(surface, 0) + its;
    double *restrict kept = flips->kept, *restrict cost = flips->cost;
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const double left = flow(corner, corner_slope, here[k] - there[k - 1]);
        const double straight = flow(side, side_slope, here[k] - there[k]);
        const double right = flow(corner, corner_slope, here[k] - there[k + 1]);
        const double sign = flips->sign[k];
        kept[k] -= left + straight + right;
        cost[k] += neighbour_cost(surface, its + k - 1, sign * left, counted) +
                   neighbour_cost(surface, its + k, sign * straight, counted) +
                   neighbour_cost(surface, its + k + 1, sign * right, counted);
    }
}

/* The same in their own row, on the cells themselves as well. */
static INLINED void add_own_row(const PlanSurface *surface, size_t cell, size_t count, const Counted counted,
                                FlipRow *flips) {
    const double spread = surface->droplet[1].spread[SIDE], slope = surface->droplet[1].slope[SIDE];
    const double *here = surface_height(surface, 0) + cell;
    double *restrict cost = flips->cost;
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const double left = flow(spread, slope, here[k] - here[k - 1]);
        const double right = flow(spread, slope, here[k] - here[k + 1]);
        const double sign = flips->sign[k], kept = flips->kept[k] - left - right;
        const double chance = surface_chance(surface, sign > 0.0 ? kept : 0.0);
        cost[k] += neighbour_cost(surface, cell + k - 1, sign * left, counted) +
                   neighbour_cost(surface, cell + k + 1, sign * right, counted) +
                   cost_of(surface, cell + k, surface_height(surface, 1)[cell + k] + sign * kept, chance, counted) -
                   surface->cost[cell + k];
    }
}

static INLINED void read_cells(FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                               const Counted counted) {
    const uint8_t *plan = surface_layer(surface, 0) + cell;
    const double most = bounds->most;
    FlipRow flips;
    for (size_t k = 0; k < count; k++) {
        flips.kept[k] = surface->droplet[1].volume;
        flips.sign[k] = plan[k] ? -1.0 : 1.0;
        flips.cost[k] = 0.0;
    }
    add_row(surface, cell, cell - surface->stride, count, counted, &flips);
    add_row(surface, cell, cell + surface->stride, count, counted, &flips);
    add_own_row(surface, cell, count, counted, &flips);
    AS_LOOP for (size_t k = 0; k < count; k++) bounds->least[cell + k] =
        (float)(flips.cost[k] > most ? most : flips.cost[k]);
}

static INLINED bool is_renewal_useful(const FlipBounds *bounds, size_t cell, size_t count, const Renewal *renewal) {
    const float *least = bounds->least + cell;
    const uint8_t *awake = renewal->awake + cell;
    const uint32_t move = renewal->move;
    uint64_t cells = 0;
    memcpy(&cells, awake, count);
    if (!(cells & move * UINT64_C(0x0101010101010101))) /* mostly so, and the bounds need not be looked at */
        return false;
    uint32_t open = 0;
    AS_LOOP for (size_t k = 0; k < count; k++) open += least[k] > renewal->limit ? 0u : awake[k] & move;
    return open >= LEAST_OPEN * move;
}

static INLINED void renew_cells(FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count) {
    static const Counted NOTHING = {false, false}, CHANCE = {true, false}, CEILING = {false, true}, BOTH = {true, true};
    if (surface->chance > 0.0 && surface->ceiling)
        read_cells(bounds, surface, cell, count, BOTH);
    else if (surface->chance > 0.0)
        read_cells(bounds, surface, cell, count, CHANCE);
    else if (surface->ceiling)
        read_cells(bounds, surface, cell, count, CEILING);
    else
        read_cells(bounds, surface, cell, count, NOTHING);
}

static INLINED void renew_row(FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t end,
                              const Renewal *renewal) {
    size_t first = cell; /* of the cells that are read together, as far as `cell` */
    for (bool is_end = false; !is_end; cell += CHUNK) {
        is_end = cell >= end;
        if (!is_end && (end - cell < CHUNK ? is_renewal_useful(bounds, cell, end - cell, renewal)
                                           : is_renewal_useful(bounds, cell, CHUNK, renewal)))
            continue;
        const size_t last = is_end ? end : cell;
        if (last > first)
            renew_cells(bounds, surface, first, last - first);
        first = cell + CHUNK;
    }
}

static INLINED void renew(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile, const Renewal *renewal) {
    for (size_t i = tile->top; i < tile->bottom; i++)
        renew_row(bounds, surface, surface_cell(surface, i, tile->left), surface_cell(surface, i, tile->right),
                  renewal);
}

static void renew_plain(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile, const Renewal *renewal) {
    renew(bounds, surface, tile, renewal);
}

static WITH_AVX2 void renew_avx2(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile,
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

static void forget_cells(float *least, size_t count) {
    if (count == 2 * FLIP_REACH + 1)                                    /* a constant length takes two instructions */
        memset(least, UINT8_MAX, (2 * FLIP_REACH + 1) * sizeof *least); /* NaN */
    else
        memset(least, UINT8_MAX, count * sizeof *least);
}

void flip_bounds_change(FlipBounds *bounds, const PlanSurface *surface, size_t i, size_t j, unsigned value,
                        double flip) {
    const size_t top = i > FLIP_REACH ? i - FLIP_REACH : 0, left = j > FLIP_REACH ? j - FLIP_REACH : 0;
    const size_t bottom = i + FLIP_REACH < surface->nx ? i + FLIP_REACH : surface->nx - 1;
    const size_t right = j + FLIP_REACH < surface->ny ? j + FLIP_REACH : surface->ny - 1;
    const uint8_t *plan = surface_layer(surface, 0) + surface_cell(surface, i, 0);
    if (!bounds->least)
        return;
    for (size_t row = top; row <= bottom; row++)
        forget_cells(bounds->least + surface_cell(surface, row, left), row == i ? j - left : right - left + 1);
    for (size_t column = j + 1; column <= right; column++)
        bounds->least[surface_cell(surface, i, column)] -= plan[column] == value ? bounds->loss[0][column - j] : 0.0f;
    flip_bounds_put(bounds, surface_cell(surface, i, j), flip);
}
