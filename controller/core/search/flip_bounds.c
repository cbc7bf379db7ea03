#include "flip_bounds.h"

#include <stdlib.h>
#include <string.h>

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
    bounds->least = malloc(surface->framed * sizeof(float));
    if (bounds->least)
        flip_bounds_clear(bounds, surface);
    return bounds->least != NULL;
}

void flip_bounds_close(FlipBounds *bounds) {
    free(bounds->least);
    bounds->least = NULL;
}

void flip_bounds_clear(FlipBounds *bounds, const PlanSurface *surface) {
    if (bounds->least)
        memset(bounds->least, UINT8_MAX, surface->framed * sizeof(float)); /* NaN */
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
