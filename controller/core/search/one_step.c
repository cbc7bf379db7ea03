#include "one_step.h"

#include "one_step_cells.h"

static size_t first_of(const PlanSurface *surface, const Change *change) {
    return change->i * surface->stride + change->j; /* one row up and one column to the left */
}

/* What the change does to its cells, with room for `raised`. */
static CellsChange cells_change(const PlanSurface *surface, const Change *change, double *raised) {
    const unsigned from = surface_layer(surface, 0)[surface_cell(surface, change->i, change->j)];
    double shares[THREE] = {0.0};
    CellsChange made = {first_of(surface, change), raised, 0.0};
    if (from)
        take_shares(surface, made.first, from, shares);
    for (size_t k = 0; k < THREE; k++)
        raised[k] = -shares[k];
    if (change->value) {
        take_shares(surface, made.first, change->value, shares);
        made.kept = shares[MIDDLE];
        for (size_t k = 0; k < THREE; k++)
            raised[k] += shares[k];
    }
    return made;
}

Sums one_step_trial(const PlanSurface *surface, const Change *change, size_t count, bool cost_alone) {
    double raised[CHANGES_MAX][THREE], cost[THREE];
    const CellsChange one = cells_change(surface, change, raised[0]);
    const Sums sums = look_at_change(surface, &one, cost_alone, cost);
    if (count == 1)
        return sums;
    const CellsChange two = cells_change(surface, &change[1], raised[1]);
    const size_t near = near_of(change[1].i + 1 - change->i, change[1].j + 1 - change->j);
    FirstChange first;
    first_open(&first);
    first_put(surface, &one, cost, &sums, &first);
    return look_at_second(surface, &first, near, &two, cost_alone);
}

/* On the cells of the grid alone, and on those that the droplet reaches: another thread may be at the others. */
static void apply_change(PlanSurface *surface, const Change *change) {
    double raised[THREE], *last = surface_height(surface, 1);
    const CellsChange made = cells_change(surface, change, raised);
    const size_t top = change->i > 0 ? 0 : 1, bottom = change->i + 1 < surface->nx ? 2 : 1;
    const size_t left = change->j > 0 ? 0 : 1, right = change->j + 1 < surface->ny ? 2 : 1;
    if (surface->chance > 0.0) /* else the map stays 0, and its memory untouched */
        surface->left_to_chance[made.first + surface->stride + 1] = surface_chance(surface, made.kept);
    for (size_t row = top; row <= bottom; row++)
        for (size_t column = left; column <= right; column++) {
            const size_t cell = made.first + row * surface->stride + column;
            last[cell] += raised[row * LANES + column];
            surface->cost[cell] = surface_cost(surface, cell, last[cell], surface->left_to_chance[cell]);
        }
}

void one_step_apply(PlanSurface *surface, const Change *change, size_t count) {
    for (size_t k = 0; k < count; k++)
        apply_change(surface, &change[k]);
}
