#include "one_step.h"

#include "one_step_cells.h"

static size_t first_of(const PlanSurface *surface, const Change *change) {
    return change->i * surface->stride + change->j; /* one row up and one column to the left */
}

/* What a droplet on a cell, or none, gives to its cells, with room for it. */
static const double *shares_on(const PlanSurface *surface, size_t first, unsigned value, double *shares) {
    if (!value)
        return NO_SHARES;
    take_shares(surface, first, value, shares);
    return shares;
}

static CellsChange cells_change(const PlanSurface *surface, const Change *change, double shares[2][THREE]) {
    const unsigned from = surface_layer(surface, 0)[surface_cell(surface, change->i, change->j)];
    const size_t first = first_of(surface, change);
    return (CellsChange){first, shares_on(surface, first, from, shares[0]),
                         shares_on(surface, first, change->value, shares[1])};
}

Sums one_step_trial(const PlanSurface *surface, const Change *change, size_t count, bool cost_alone) {
    double shares[CHANGES_MAX][2][THREE];
    const CellsChange one = cells_change(surface, change, shares[0]);
    if (count == 1)
        return look_at_change(surface, &one, cost_alone);
    const CellsChange two = cells_change(surface, &change[1], shares[1]);
    const size_t near = near_of(change[1].i + 1 - change->i, change[1].j + 1 - change->j);
    FirstChange first;
    first_open(&first);
    look_at_first(surface, &one, cost_alone, &first);
    return look_at_second(surface, &first, near, &two, cost_alone);
}

/* On the cells of the grid alone, and on those that the droplet reaches: another thread may be at the others. */
static void apply_change(PlanSurface *surface, const Change *change) {
    double shares[2][THREE], *last = surface_height(surface, 1);
    const CellsChange made = cells_change(surface, change, shares);
    const size_t top = change->i > 0 ? 0 : 1, bottom = change->i + 1 < surface->nx ? 2 : 1;
    const size_t left = change->j > 0 ? 0 : 1, right = change->j + 1 < surface->ny ? 2 : 1;
    if (surface->chance > 0.0) /* else the map stays 0, and its memory untouched */
        surface->left_to_chance[made.first + surface->stride + 1] = surface_chance(surface, made.come[MIDDLE]);
    for (size_t row = top; row <= bottom; row++)
        for (size_t column = left; column <= right; column++) {
            const size_t cell = made.first + row * surface->stride + column;
            last[cell] += made.come[row * LANES + column] - made.gone[row * LANES + column];
            surface->cost[cell] = surface_cost(surface, cell, last[cell], surface->left_to_chance[cell]);
        }
}

void one_step_apply(PlanSurface *surface, const Change *change, size_t count) {
    for (size_t k = 0; k < count; k++)
        apply_change(surface, &change[k]);
}
