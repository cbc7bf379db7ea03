#include "one_step.h"

#include <math.h>
#include <string.h>

#include "instruction_sets.h"

enum { LANES = 4, THREE = 3 * LANES, FOUR = 4 * LANES }; /* cells of a row that are looked at, of three rows, of four */

/* Cells around the changes, row by row; those beyond the reach of a droplet stay as they are. */
typedef struct {
    size_t first;        /* cell of the map that is the first one */
    size_t rows;         /* 3, or 4 where the changes are in different rows */
    double raised[FOUR]; /* [m] */
    double chance[FOUR]; /* after the changes [m] */
} StepBox;

/* LANES cells of each row of a map. */
static INLINED void load_cells(const double *map, size_t stride, size_t rows, double *restrict cells) {
    for (size_t row = 0; row < rows; row++) /* by name: a copy of bytes is done in pieces that do not fit a vector */
        for (size_t k = 0; k < LANES; k++)
            cells[row * LANES + k] = map[row * stride + k];
}

/* Of three rows of five cells, 1 for the one in the middle. */
static const double MIDDLE_LANES[3][LANES + 1] = {{0.0}, {0.0, 0.0, 1.0, 0.0, 0.0}, {0.0}};

/* Adds the droplet `value` in the middle of three rows of the box `sign` times, to the heights raised from there on;
 * middle: 1 there, 0 elsewhere. Returns what it leaves there. Shares are multiples of one length (lattice.h): they add
 * up to the same in any order. */
static INLINED double add_droplet(const PlanSurface *surface, unsigned value, double sign, size_t first, size_t column,
                                  const double *middle, double *raised) {
    const Droplet *droplet = &surface->droplet[value];
    const double *before = surface_height(surface, 0) + first;
    const double here = before[surface->stride + column];
    double its[THREE], spread[THREE], slope[THREE], taken[THREE], sums[LANES];
    load_cells(before, surface->stride, 3, its);
    load_cells(&droplet->spread_lanes[0][2 - column], LANES + 1, 3, spread);
    load_cells(&droplet->slope_lanes[0][2 - column], LANES + 1, 3, slope);
    for (size_t k = 0; k < THREE; k++)
        taken[k] = flow(spread[k], slope[k], here - its[k]);
    for (size_t k = 0; k < LANES; k++)
        sums[k] = taken[k] + taken[LANES + k] + taken[2 * LANES + k];
    const double kept = droplet->volume - (sums[0] + sums[1] + (sums[2] + sums[3]));
    for (size_t k = 0; k < THREE; k++) /* whole vectors: a number written into one would hold up its next reader */
        raised[k] += sign * (taken[k] + middle[k] * kept);
    return kept;
}

static INLINED size_t smaller(size_t a, size_t b) {
    return a < b ? a : b;
}

/* What the changes do to heights and chances. */
static INLINED void look_at_changes(const PlanSurface *surface, const Change *change, size_t count, StepBox *box) {
    const Change *other = &change[count - 1];
    const size_t top = smaller(change->i, other->i), left = smaller(change->j, other->j); /* counted with the frame */
    box->first = top * surface->stride + left;
    box->rows = change->i == other->i ? 3 : 4;
    load_cells(surface->left_to_chance + box->first, surface->stride, box->rows, box->chance);
    for (size_t k = 0; k < FOUR; k++)
        box->raised[k] = 0.0;
    for (size_t k = 0; k < count; k++) {
        const size_t row = change[k].i - top, column = change[k].j - left + 1; /* row: the one above it */
        const size_t first = box->first + row * surface->stride;
        const unsigned value = surface_layer(surface, 0)[first + surface->stride + column];
        double kept = 0.0, middle[THREE];
        load_cells(&MIDDLE_LANES[0][2 - column], LANES + 1, 3, middle);
        if (value)
            add_droplet(surface, value, -1.0, first, column, middle, box->raised + row * LANES);
        if (change[k].value)
            kept = add_droplet(surface, change[k].value, 1.0, first, column, middle, box->raised + row * LANES);
        const double chance = surface_chance(surface, kept);
        for (size_t c = 0; surface->chance > 0.0 && c < THREE; c++)
            box->chance[row * LANES + c] = middle[c] > 0.0 ? chance : box->chance[row * LANES + c];
    }
}

/* What the heights `is` cost. */
static INLINED void cell_costs(const PlanSurface *surface, const StepBox *box, size_t rows, const double *is,
                               double *restrict cost) {
    const double upward = surface->upward, skew = surface->skew, steep = surface->problem->ceiling_cost;
    double target[FOUR], weight[FOUR], ceiling[FOUR];
    load_cells(surface->target + box->first, surface->stride, rows, target);
    load_cells(surface->weight + box->first, surface->stride, rows, weight);
    for (size_t k = 0; k < rows * LANES; k++)
        cost[k] = fabs(is[k] - target[k]);
    for (size_t k = 0; surface->chance > 0.0 && k < rows * LANES; k++) {
        const double chance = box->chance[k], size = cost[k], safe = chance > 0.0 ? chance : 1.0;
        const double expected = 0.5 * (size * size / safe + chance);
        cost[k] = size < chance ? expected : size;
    }
    for (size_t k = 0; k < rows * LANES; k++)
        cost[k] = upward * cost[k] + skew * (is[k] - target[k]);
    if (surface->ceiling) {
        load_cells(surface->ceiling + box->first, surface->stride, rows, ceiling);
        for (size_t k = 0; k < rows * LANES; k++) {
            const double above = is[k] - ceiling[k];
            cost[k] += above > 0.0 ? steep * above : 0.0;
        }
    }
    for (size_t k = 0; k < rows * LANES; k++)
        cost[k] *= weight[k];
}

/* The change of the sums of heights and their squares. */
static INLINED void add_heights(const PlanSurface *surface, const StepBox *box, size_t rows, const double *was,
                                const double *is, Sums *sums) {
    const double reference = surface->reference;
    double chance_was[FOUR], inside[FOUR], height[FOUR], square[FOUR];
    load_cells(surface->left_to_chance + box->first, surface->stride, rows, chance_was);
    load_cells(surface->inside + box->first, surface->stride, rows, inside);
    for (size_t k = 0; k < rows * LANES; k++) {
        height[k] = inside[k] * (is[k] - was[k]);
        square[k] = height[k] * ((is[k] - reference) + (was[k] - reference)) +
                    inside[k] * (box->chance[k] * box->chance[k] - chance_was[k] * chance_was[k]) / 3.0;
    }
    for (size_t k = 0; k < rows * LANES; k++) {
        sums->height += height[k];
        sums->squared_height += square[k];
    }
}

static INLINED Sums sums_of_rows(const PlanSurface *surface, const StepBox *box, const size_t rows, bool cost_alone) {
    double was[FOUR], is[FOUR], cost[FOUR], cost_was[FOUR];
    Sums sums = {0.0, 0.0, 0.0};
    load_cells(surface_height(surface, 1) + box->first, surface->stride, rows, was);
    load_cells(surface->cost + box->first, surface->stride, rows, cost_was);
    for (size_t k = 0; k < rows * LANES; k++)
        is[k] = was[k] + box->raised[k];
    cell_costs(surface, box, rows, is, cost);
    for (size_t k = 0; k < rows * LANES; k++)
        cost[k] -= cost_was[k];
    for (size_t k = 0; k < rows * LANES; k++) /* in the order of the cells */
        sums.cost += cost[k];
    if (!cost_alone)
        add_heights(surface, box, rows, was, is, &sums);
    return sums;
}

static INLINED Sums trial(const PlanSurface *surface, const Change *change, size_t count, bool cost_alone) {
    StepBox box;
    look_at_changes(surface, change, count, &box);
    return box.rows == 3 ? sums_of_rows(surface, &box, 3, cost_alone) : sums_of_rows(surface, &box, 4, cost_alone);
}

static Sums trial_plain(const PlanSurface *surface, const Change *change, size_t count, bool cost_alone) {
    return trial(surface, change, count, cost_alone);
}

static WITH_AVX2 Sums trial_avx2(const PlanSurface *surface, const Change *change, size_t count, bool cost_alone) {
    return trial(surface, change, count, cost_alone);
}

Sums one_step_trial(const PlanSurface *surface, const Change *change, size_t count, bool cost_alone) {
    return (HAS_AVX2 ? trial_avx2 : trial_plain)(surface, change, count, cost_alone);
}

void one_step_apply(PlanSurface *surface, const Change *change, size_t count) {
    StepBox box;
    look_at_changes(surface, change, count, &box);
    double *last = surface_height(surface, 1);
    for (size_t k = 0; k < box.rows * LANES; k++) {
        const size_t cell = box.first + k / LANES * surface->stride + k % LANES;
        const size_t row = cell / surface->stride, column = cell % surface->stride;
        const bool is_inside = row > 0 && row <= surface->nx && column > 0 && column <= surface->ny;
        if (!is_inside || (box.raised[k] == 0.0 && box.chance[k] == surface->left_to_chance[cell]))
            continue; /* the frame, or cells that another thread may be at */
        last[cell] += box.raised[k];
        surface->left_to_chance[cell] = box.chance[k];
        surface->cost[cell] = surface_cost(surface, cell, last[cell], box.chance[k]);
    }
}
