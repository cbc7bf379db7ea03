#include "flip_bounds.h"

#include <stdlib.h>
#include <string.h>

#include "instruction_sets.h"

static const double SURE = 1e-3; /* of what a neighbour changes: far above the rounding of bounds below MOST */
static const double MOST = 32.0; /* of the same: more than all cells near take away together */

/* The steepest that the slope of a cell's cost can change by. */
static double slope_change(const PlanSurface *surface) {
    double heaviest = 0.0;
    for (size_t cell = 0; cell < surface->framed; cell++)
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
    bounds->columns = (surface->ny + TILE - 1) / TILE;
    bounds->tiles = (surface->nx + TILE - 1) / TILE * bounds->columns;
    bounds->least = malloc(surface->framed * sizeof(float) + bounds->tiles);
    if (!bounds->least)
        return false;
    bounds->is_read = (uint8_t *)(bounds->least + surface->framed);
    flip_bounds_clear(bounds, surface);
    return true;
}

void flip_bounds_close(FlipBounds *bounds) {
    free(bounds->least);
    bounds->least = NULL;
}

void flip_bounds_clear(FlipBounds *bounds, const PlanSurface *surface) {
    if (!bounds->least)
        return;
    memset(bounds->least, UINT8_MAX, surface->framed * sizeof(float)); /* NaN */
    memset(bounds->is_read, 0, bounds->tiles);
}

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
    const double ceiling = above > 0.0 ? surface->problem->ceiling_cost * above : 0.0;
    return surface->weight[cell] * (surface->upward * expected + surface->skew * error + ceiling);
}

/* Flips of a row of a tile: what is left of each droplet, +1 where it comes or -1 where it goes, and what that costs.
 */
typedef struct {
    double kept[TILE], sign[TILE], cost[TILE];
} FlipRow;

/* Adds what the flips of a row from `cell` on do to the cost of their neighbours `ahead` cells further. */
static INLINED void add_neighbours(const PlanSurface *surface, size_t cell, size_t count, int place, ptrdiff_t ahead,
                                   const Counted counted, FlipRow *flips) {
    const double spread = surface->droplet[1].spread[place], slope = surface->droplet[1].slope[place];
    const double *before = surface_height(surface, 0) + cell, *its = before + ahead;
    const size_t first = cell + (size_t)ahead;
    const double *last = surface_height(surface, 1) + first, *chance = surface->left_to_chance + first;
    double *restrict kept = flips->kept, *restrict cost = flips->cost;
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const double share = flow(spread, slope, before[k] - its[k]);
        const double height = last[k] + flips->sign[k] * share;
        kept[k] -= share;
        cost[k] +=
            cost_of(surface, first + k, height, counted.chance ? chance[k] : 0.0, counted) - surface->cost[first + k];
    }
}

static INLINED void read_row(FlipBounds *bounds, const PlanSurface *surface, size_t cell, size_t count,
                             const Counted counted) {
    const ptrdiff_t row = (ptrdiff_t)surface->stride;
    const double *last = surface_height(surface, 1) + cell;
    const uint8_t *plan = surface_layer(surface, 0) + cell;
    FlipRow flips;
    for (size_t k = 0; k < count; k++) {
        flips.kept[k] = surface->droplet[1].volume;
        flips.sign[k] = plan[k] ? -1.0 : 1.0;
        flips.cost[k] = 0.0;
    }
    for (ptrdiff_t ahead = -1; ahead <= 1; ahead += 2) {
        add_neighbours(surface, cell, count, SIDE, ahead, counted, &flips);
        add_neighbours(surface, cell, count, SIDE, ahead * row, counted, &flips);
        add_neighbours(surface, cell, count, CORNER, ahead * (row - 1), counted, &flips);
        add_neighbours(surface, cell, count, CORNER, ahead * (row + 1), counted, &flips);
    }
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const double chance = surface_chance(surface, flips.sign[k] > 0.0 ? flips.kept[k] : 0.0);
        const double height = last[k] + flips.sign[k] * flips.kept[k];
        const double cost =
            flips.cost[k] + cost_of(surface, cell + k, height, chance, counted) - surface->cost[cell + k];
        bounds->least[cell + k] = (float)(cost > (double)bounds->most ? (double)bounds->most : cost);
    }
}

static INLINED void read_tile(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile) {
    static const Counted NOTHING = {false, false};
    const Counted counted = {surface->chance > 0.0, surface->ceiling != NULL};
    for (size_t i = tile->top; i < tile->bottom; i++) {
        const size_t cell = surface_cell(surface, i, tile->left), count = tile->right - tile->left;
        if (counted.chance || counted.ceiling)
            read_row(bounds, surface, cell, count, counted);
        else
            read_row(bounds, surface, cell, count, NOTHING);
    }
}

static void read_plain(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile) {
    read_tile(bounds, surface, tile);
}

static WITH_AVX2 void read_avx2(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile) {
    read_tile(bounds, surface, tile);
}

void flip_bounds_read(FlipBounds *bounds, const PlanSurface *surface, const Tile *tile) {
    if (!bounds->least)
        return;
    uint8_t *is_read = &bounds->is_read[tile->top / TILE * bounds->columns + tile->left / TILE];
    if (!*is_read)
        (HAS_AVX2 ? read_avx2 : read_plain)(bounds, surface, tile);
    *is_read = 1;
}

void flip_bounds_change(FlipBounds *bounds, const PlanSurface *surface, size_t i, size_t j, unsigned value,
                        double flip) {
    const size_t top = i > FLIP_REACH ? i - FLIP_REACH : 0, left = j > FLIP_REACH ? j - FLIP_REACH : 0;
    const size_t bottom = i + FLIP_REACH < surface->nx ? i + FLIP_REACH : surface->nx - 1;
    const size_t right = j + FLIP_REACH < surface->ny ? j + FLIP_REACH : surface->ny - 1;
    if (!bounds->least)
        return;
    for (size_t row = top; row <= bottom; row++) {
        const uint8_t *plan = surface_layer(surface, 0) + surface_cell(surface, row, 0);
        float *least = bounds->least + surface_cell(surface, row, 0);
        const float *loss = bounds->loss[row < i ? i - row : row - i];
        for (size_t column = left; column <= right; column++)
            least[column] -= plan[column] == value ? loss[column < j ? j - column : column - j] : 0.0f;
    }
    flip_bounds_put(bounds, surface_cell(surface, i, j), flip);
}
