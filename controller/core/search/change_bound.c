#include "change_bound.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What rounding moves in a step in sum, as a share of the largest difference. 49 cells have 8 pairs each; a pair and
 * the sums that it goes through are rounded by less than 12 times 2^-24 of that difference, times a slope below 1/4:
 * 7e-5 at most. */
static const double ROUNDING = 1e-4;

static const double DROPLET_OF_MOST = 0.25; /* the largest droplet, as a share of the largest difference */

enum { LEAST_STEPS = 3 }; /* fewer are tried as quickly (by trial) */

/* Differences of heights as they spread, from cell NEAR_MARGIN on. */
typedef struct {
    float before[NEAR_MAP], after[NEAR_MAP];
    float left[NEAR_LANES];   /* out of sight, in sum, by lanes [m] */
    float chance[NEAR_CELLS]; /* after the last step [m] */
    float most;               /* the largest difference after the last step [m] */
    size_t top, bottom;       /* rows that differ; bottom excluded */
} Spread;

bool bound_open(ChangeBound *bound, const PlanSurface *surface) {
    double weight = 0.0;
    *bound = (ChangeBound){.is_read = false};
    if (surface->steps < LEAST_STEPS || !near_rules(surface, &bound->rules))
        return true;
    bound->step = calloc(surface->steps, sizeof(NearStep));
    for (size_t cell = 0; cell < surface->framed; cell++)
        weight = fmax(weight, surface->weight[cell]);
    const double steep = surface->upward + fabs(surface->skew);
    bound->cost_slope = weight * (steep + (surface->ceiling ? surface->problem->ceiling_cost : 0.0));
    bound->chance_slope = weight * surface->upward * surface->chance; /* half of it, times twice what is out of sight */
    return bound->step != NULL;
}

void bound_close(ChangeBound *bound) {
    free(bound->step);
}

/* Costs of cells as in surface_cost. */
static INLINED void add_costs(const PlanSurface *surface, const float *restrict error, const float *restrict above,
                              const float *restrict chance, const float *restrict weight, size_t count,
                              float *restrict cost) {
    const float upward = (float)surface->upward, skew = (float)surface->skew;
    const float steep = surface->ceiling ? (float)surface->problem->ceiling_cost : 0.0f;
    for (size_t k = 0; k < count; k++) {
        const float size = fabsf(error[k]), safe = larger_of(chance[k], 1e-30f);
        const float near = 0.5f * (size * size / safe + chance[k]), expected = size < chance[k] ? near : size;
        cost[k] += weight[k] * (upward * expected + skew * error[k] + steep * larger_of(above[k], 0.0f));
    }
}

static size_t least_of(size_t a, size_t b) {
    return a < b ? a : b;
}

/* The largest height of the cells of the part that changes can reach, above or below the reference, or a larger one. */
static INLINED double highest(const PlanSurface *surface, size_t i, size_t j) {
    enum { WIDTH = MAP_MARGIN };
    const double *last = surface_height(surface, surface->steps);
    const double reference = surface->reference;
    const size_t reach = surface->steps + 2, top = i > reach ? i - reach : 0, left = j > reach ? j - reach : 0;
    const size_t bottom = least_of(surface->nx, i + reach + 1), right = least_of(surface->ny, j + reach + 1);
    double most[WIDTH] = {0.0};
    for (size_t row = top; row < bottom; row++)
        for (size_t column = left; column < right; column += WIDTH) {
            const size_t cell = surface_cell(surface, row, column);
            for (size_t k = 0; k < WIDTH; k++) {
                const double height = surface->inside[cell + k] * fabs(last[cell + k] - reference);
                most[k] = height > most[k] ? height : most[k];
            }
        }
    return fmax(fmax(most[0], most[1]), fmax(most[2], most[3]));
}

/* Beyond twice the largest difference an error may be any other of its sign. */
static INLINED void read_last(const PlanSurface *surface, ChangeBound *bound) {
    const double *last = surface_height(surface, surface->steps), reference = surface->reference;
    const float most = 2.0f * bound->rules.most;
    double height[NEAR_CELLS], other[NEAR_CELLS];
    const size_t i = bound->i, j = bound->j;
    near_copy(surface, last, i, j, 0.0, height);
    for (size_t k = 0; k < NEAR_CELLS; k++)
        bound->height[k] = (float)(height[k] - reference);
    near_copy(surface, surface->target, i, j, 0.0, other);
    for (size_t k = 0; k < NEAR_CELLS; k++)
        bound->error[k] = within(-most, (float)(height[k] - other[k]), most);
    if (surface->ceiling)
        near_copy(surface, surface->ceiling, i, j, 0.0, other);
    for (size_t k = 0; k < NEAR_CELLS; k++)
        bound->above[k] = surface->ceiling ? within(-most, (float)(height[k] - other[k]), most) : -most;
    near_copy(surface, surface->weight, i, j, 0.0, other);
    for (size_t k = 0; k < NEAR_CELLS; k++)
        bound->weight[k] = bound->is_cell[k] * (float)other[k];
    near_copy(surface, surface->inside, i, j, 0.0, other);
    for (size_t k = 0; k < NEAR_CELLS; k++)
        bound->inside[k] = bound->is_cell[k] * (float)other[k];
    near_copy(surface, surface->left_to_chance, i, j, 0.0, other);
    for (size_t k = 0; k < NEAR_CELLS; k++)
        bound->chance[k] = (float)other[k];
    memset(bound->cost, 0, sizeof bound->cost);
    add_costs(surface, bound->error, bound->above, bound->chance, bound->weight, NEAR_CELLS, bound->cost);
    bound->height_most = surface->weighting.alpha == 1.0 ? 0.0 : highest(surface, i, j);
}

static void mark_cells(const PlanSurface *surface, ChangeBound *bound) {
    for (size_t row = 0; row < NEAR_ROWS; row++)
        for (size_t lane = 0; lane < NEAR_LANES; lane++) {
            const ptrdiff_t i = (ptrdiff_t)(bound->i + row) - NEAR_REACH, j = (ptrdiff_t)(bound->j + lane) - NEAR_REACH;
            const bool is_cell =
                lane < NEAR_ROWS && i >= 0 && i < (ptrdiff_t)surface->nx && j >= 0 && j < (ptrdiff_t)surface->ny;
            bound->is_cell[row * NEAR_LANES + lane] = is_cell ? 1.0f : 0.0f;
        }
}

static void read_plain(const PlanSurface *surface, ChangeBound *bound) {
    read_last(surface, bound);
}

static WITH_AVX2 void read_avx2(const PlanSurface *surface, ChangeBound *bound) {
    read_last(surface, bound);
}

static void read(ChangeBound *bound, const PlanSurface *surface, size_t i, size_t j) {
    bound->i = i;
    bound->j = j;
    bound->is_read = true;
    mark_cells(surface, bound);
    bound->unread = surface->steps;
    (HAS_AVX2 ? read_avx2 : read_plain)(surface, bound);
}

/* Reads the steps after `number` that have not been read. */
static void read_steps(ChangeBound *bound, const PlanSurface *surface, size_t number) {
    for (; bound->unread > number + 1; bound->unread--)
        near_read(surface, &bound->rules, bound->i, bound->j, bound->unread - 1, &bound->step[bound->unread - 1]);
}

/* Adds the shares of a droplet on a near cell `sign` times; returns what it leaves there [m]. */
static double add_droplet(const PlanSurface *surface, const ChangeBound *bound, const double *heights, unsigned value,
                          float sign, size_t cell, float *after) {
    const Droplet *droplet = &surface->droplet[value];
    double kept = droplet->volume;
    for (size_t k = 0; k < FOOTPRINT; k++) {
        const size_t there = cell + k / 3 * NEAR_LANES + k % 3 - (NEAR_LANES + 1);
        const int place = k % 2 ? SIDE : CORNER;
        const double taken = flow(droplet->spread[place], droplet->slope[place], heights[CENTRE] - heights[k]);
        if (k == CENTRE)
            continue;
        after[NEAR_MARGIN + there] += sign * bound->is_cell[there] * (float)taken;
        kept -= taken;
    }
    after[NEAR_MARGIN + cell] += sign * (float)kept;
    return kept;
}

/* Puts the new droplet in the place of the old one. */
static void make_change(const PlanSurface *surface, const ChangeBound *bound, const Change *change, size_t number,
                        Spread *spread) {
    const size_t row = change->i + NEAR_REACH - bound->i, lane = change->j + NEAR_REACH - bound->j;
    const size_t near = row * NEAR_LANES + lane, cell = surface_cell(surface, change->i, change->j);
    const unsigned value = surface_layer(surface, change->layer)[cell];
    const double *map = surface_height(surface, number) + cell - (surface->stride + 1);
    const float *raised = spread->before + NEAR_MARGIN + near - (NEAR_LANES + 1);
    double heights[FOOTPRINT], kept = 0.0;
    for (size_t k = 0; k < FOOTPRINT; k++)
        heights[k] = map[k / 3 * surface->stride + k % 3] + (double)raised[k / 3 * NEAR_LANES + k % 3];
    if (value)
        add_droplet(surface, bound, heights, value, -1.0f, near, spread->after);
    if (change->value)
        kept = add_droplet(surface, bound, heights, change->value, 1.0f, near, spread->after);
    if (number + 1 == surface->steps)
        spread->chance[near] = (float)surface_chance(surface, kept);
    spread->top = least_of(spread->top, row - 1);
    spread->bottom = spread->bottom > row + 2 ? spread->bottom : row + 2;
}

/* Carries the differences through a step as it is. */
static INLINED void carry(const PlanSurface *surface, const ChangeBound *bound, const NearStep *step, bool is_mixed,
                          bool is_last, Spread *spread) {
    spread->top -= spread->top > 0;
    spread->bottom += spread->bottom < NEAR_ROWS;
    const size_t first = spread->top * NEAR_LANES, count = (spread->bottom - spread->top) * NEAR_LANES;
    const float share = (float)surface->chance, least = (float)surface->least_chance;
    const float *leaving = bound->rules.leaving + first, *is_cell = bound->is_cell + first;
    const float *was = bound->chance + first, *before = spread->before;
    const float *lost_level = step->lost + NEAR_MARGIN + first, *given_level = step->given + NEAR_MARGIN + first;
    float *restrict after = spread->after + NEAR_MARGIN + first, *restrict chance = spread->chance + first;
    float away[NEAR_CELLS];
    memcpy(spread->before + NEAR_MARGIN + first, after, count * sizeof(float));
    for (size_t k = 0; k < count; k++) {
        float given;
        const float own = before[NEAR_MARGIN + first + k], leaves = leaving[k] * own;
        const float lost =
            near_loss(step, bound->rules.slope, is_mixed, is_last, before, NEAR_MARGIN + first + k, &given);
        away[k] = fabsf(leaves);
        after[k] = is_cell[k] * (own - (lost - lost_level[k]) - leaves);
        if (is_last)
            chance[k] = larger_of(was[k] - share * (given - given_level[k]), least);
    }
    for (size_t row = 0; row < count; row += NEAR_LANES)
        for (size_t k = 0; k < NEAR_LANES; k++)
            spread->left[k] += away[row + k];
}

/* What the differences after the last step add to the sums. */
static INLINED Sums added_sums(const PlanSurface *surface, const ChangeBound *bound, Spread *spread) {
    const size_t first = spread->top * NEAR_LANES, count = (spread->bottom - spread->top) * NEAR_LANES;
    const float *after = spread->after + NEAR_MARGIN + first, *chance = spread->chance + first;
    const float *was = bound->chance + first, *inside = bound->inside + first, *high = bound->height + first;
    float error[NEAR_CELLS], above[NEAR_CELLS], cost[NEAR_CELLS], height[NEAR_CELLS], square[NEAR_CELLS];
    for (size_t k = 0; k < count; k++) {
        error[k] = bound->error[first + k] + after[k];
        above[k] = bound->above[first + k] + after[k];
        cost[k] = -bound->cost[first + k];
        height[k] = inside[k] * after[k];
        square[k] = inside[k] * (after[k] * (2.0f * high[k] + after[k]) +
                                 (chance[k] - was[k]) * (chance[k] + was[k]) * (1.0f / 3.0f));
    }
    add_costs(surface, error, above, chance, bound->weight + first, count, cost);
    float sums[3][NEAR_LANES] = {{0.0f}}, most[NEAR_LANES] = {0.0f};
    for (size_t row = 0; row < count; row += NEAR_LANES)
        for (size_t k = 0; k < NEAR_LANES; k++) {
            most[k] = larger_of(most[k], fabsf(after[row + k]));
            sums[0][k] += cost[row + k];
            sums[1][k] += height[row + k];
            sums[2][k] += square[row + k];
        }
    Sums added = {0.0, 0.0, 0.0};
    spread->most = 0.0f;
    for (size_t k = 0; k < NEAR_LANES; k++) {
        spread->most = larger_of(spread->most, most[k]);
        added = (Sums){added.cost + (double)sums[0][k], added.height + (double)sums[1][k],
                       added.squared_height + (double)sums[2][k]};
    }
    return added;
}

static INLINED void spread_changes(const PlanSurface *surface, const ChangeBound *bound, const Change *change,
                                   size_t count, size_t first, Spread *spread, Sums *added) {
    const float zero = bound->rules.none; /* by name: the processor fills such small arrays slowly */
    for (size_t k = 0; k < NEAR_MAP; k++)
        spread->before[k] = spread->after[k] = zero;
    for (size_t k = 0; k < NEAR_LANES; k++)
        spread->left[k] = zero;
    for (size_t k = 0; k < NEAR_CELLS; k++)
        spread->chance[k] = bound->chance[k];
    spread->top = NEAR_ROWS;
    spread->bottom = 0;
    for (size_t number = first; number < surface->steps; number++) {
        const NearStep *step = &bound->step[number];
        const bool is_last = number + 1 == surface->steps;
        if (spread->bottom > 0 && bound->rules.is_mixed && is_last)
            carry(surface, bound, step, true, true, spread);
        else if (spread->bottom > 0 && bound->rules.is_mixed)
            carry(surface, bound, step, true, false, spread);
        else if (spread->bottom > 0 && is_last)
            carry(surface, bound, step, false, true, spread);
        else if (spread->bottom > 0)
            carry(surface, bound, step, false, false, spread);
        for (size_t k = 0; k < count; k++)
            if (surface_step(surface, change[k].layer, change[k].i, change[k].j) == number)
                make_change(surface, bound, &change[k], number, spread);
    }
    *added = added_sums(surface, bound, spread);
}

static void spread_plain(const PlanSurface *surface, const ChangeBound *bound, const Change *change, size_t count,
                         size_t first, Spread *spread, Sums *added) {
    spread_changes(surface, bound, change, count, first, spread, added);
}

static WITH_AVX2 void spread_avx2(const PlanSurface *surface, const ChangeBound *bound, const Change *change,
                                  size_t count, size_t first, Spread *spread, Sums *added) {
    spread_changes(surface, bound, change, count, first, spread, added);
}

double change_bound(ChangeBound *bound, const PlanSurface *surface, size_t i, size_t j, const Change *change,
                    size_t count, const Sums *sums) {
    const Weighting *weighting = &surface->weighting;
    Spread spread;
    Sums added;
    if (!bound->step)
        return -INFINITY;
    size_t first = surface->steps;
    for (size_t k = 0; k < count; k++)
        first = least_of(first, surface_step(surface, change[k].layer, change[k].i, change[k].j));
    if (surface->steps < first + LEAST_STEPS)
        return -INFINITY;
    if (!bound->is_read || bound->i != i || bound->j != j)
        read(bound, surface, i, j);
    read_steps(bound, surface, first);
    (HAS_AVX2 ? spread_avx2 : spread_plain)(surface, bound, change, count, first, &spread, &added);
    double unseen = ROUNDING * (double)bound->rules.most * (double)surface->steps;
    for (size_t k = 0; k < NEAR_LANES; k++)
        unseen += (double)spread.left[k];
    double slope = weighting->alpha * (bound->cost_slope + bound->chance_slope);
    if (weighting->alpha < 1.0) {
        const Sums after = sums_after(sums, &added);
        const double mean = fabs(after.height) / weighting->count;
        const double by_chance = surface->chance * surface->chance * DROPLET_OF_MOST * (double)bound->rules.most;
        const double most = (double)spread.most + bound->height_most + mean + by_chance;
        slope += (1.0 - weighting->alpha) * most / deviation(&after, weighting);
    }
    return objective_change(sums, &added, weighting) - slope * unseen / weighting->count;
}
