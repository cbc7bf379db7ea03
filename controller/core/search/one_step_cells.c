#include "one_step_cells.h"

#include "instruction_sets.h"

/* Separate functions for each set of instructions: gcc 12 keeps only functions this small in whole vectors. */

/* 1 for the cell in the middle. */
static const double MIDDLE_LANES[THREE] = {[MIDDLE] = 1.0};

/* LANES cells of each of three rows of a map. */
static INLINED void load_cells(const double *map, size_t stride, double *restrict cells) {
    /* element by element: a copy of bytes is done in pieces that do not fit a vector */
    for (size_t row = 0; row < 3; row++)
        for (size_t k = 0; k < LANES; k++)
            cells[row * LANES + k] = map[row * stride + k];
}

/* Sum over the droplet's reach, column by column. */
static INLINED double sum_of(const double *cells) {
    double sums[LANES];
    for (size_t k = 0; k < LANES; k++)
        sums[k] = cells[k] + cells[LANES + k] + cells[2 * LANES + k];
    return sums[0] + sums[1] + sums[2];
}

/* Height that a droplet on the middle of the cells from `first` on adds to each of them [m]. */
static INLINED void shares_of(const PlanSurface *surface, size_t first, unsigned value, double *restrict shares) {
    const Droplet *droplet = &surface->droplet[value];
    const double *before = surface_height(surface, 0) + first;
    const double here = before[surface->stride + 1];
    double its[THREE], spread[THREE], slope[THREE], taken[THREE];
    load_cells(before, surface->stride, its);
    load_cells(&droplet->spread_lanes[0][1], LANES + 1, spread);
    load_cells(&droplet->slope_lanes[0][1], LANES + 1, slope);
    for (size_t k = 0; k < THREE; k++)
        taken[k] = flow(spread[k], slope[k], here - its[k]);
    const double kept = droplet->volume - sum_of(taken);
    for (size_t k = 0; k < THREE; k++) /* whole vectors: an element written into one would stall its next reader */
        shares[k] = taken[k] + MIDDLE_LANES[k] * kept;
}

/* A change by its cells: `first` is the first one in the maps. */
typedef struct {
    size_t first;
    double raised[THREE]; /* height change of its cells [m] */
    double chance;        /* uncertainty of its own cell after the change [m] */
} RaisedCells;

static INLINED void raise_cells(const PlanSurface *surface, const CellChange *change, RaisedCells *restrict cells) {
    const unsigned from = change->from, to = change->to;
    /* without a branch: one of the two is mostly 0, and branch prediction would fail */
    const double sign = to ? 1.0 : -1.0;
    double shares[THREE], gone[THREE];
    cells->first = change->i * surface->stride + change->j; /* one row up and one column to the left */
    shares_of(surface, cells->first, to ? to : from, shares);
    cells->chance = surface_chance(surface, to ? shares[MIDDLE] : 0.0);
    for (size_t k = 0; k < THREE; k++)
        cells->raised[k] = sign * shares[k];
    if (from == 0 || to == 0)
        return;
    shares_of(surface, cells->first, from, gone);
    for (size_t k = 0; k < THREE; k++)
        cells->raised[k] -= gone[k];
}

/* Terms that count: constants wherever a function is inlined, so that most trials take a short version. */
typedef struct {
    bool cost_alone; /* the other sums stay 0 */
    bool chance, ceiling;
} Asked;

static const Asked COST_ALONE = {true, false, false};

static inline Asked asked_of(const PlanSurface *surface, bool cost_alone) {
    return (Asked){cost_alone, surface->chance > 0.0, surface->ceiling != NULL};
}

static inline bool is_cost_alone(const Asked *asked) {
    return asked->cost_alone && !asked->chance && !asked->ceiling;
}

/* Costs of the heights `is` with the uncertainties `chance`: see surface_cost. */
static INLINED void costs_of(const PlanSurface *surface, size_t first, const double *is, const double *chance,
                             double *restrict cost, const Asked asked) {
    const double upward = surface->upward, skew = surface->skew, steep = surface->problem->ceiling_cost;
    double target[THREE], weight[THREE], ceiling[THREE];
    load_cells(surface->target + first, surface->stride, target);
    load_cells(surface->weight + first, surface->stride, weight);
    for (size_t k = 0; k < THREE; k++)
        cost[k] = fabs(is[k] - target[k]);
    for (size_t k = 0; asked.chance && k < THREE; k++) {
        const double size = cost[k], safe = chance[k] > 0.0 ? chance[k] : 1.0;
        const double expected = 0.5 * (size * size / safe + chance[k]);
        cost[k] = size < chance[k] ? expected : size;
    }
    for (size_t k = 0; k < THREE; k++)
        cost[k] = upward * cost[k] + skew * (is[k] - target[k]);
    if (asked.ceiling) {
        load_cells(surface->ceiling + first, surface->stride, ceiling);
        for (size_t k = 0; k < THREE; k++) {
            const double above = is[k] - ceiling[k];
            cost[k] += above > 0.0 ? steep * above : 0.0;
        }
    }
    for (size_t k = 0; k < THREE; k++)
        cost[k] *= weight[k];
}

/* Adds the change of heights and their squares to the sums. */
static INLINED void add_heights(const PlanSurface *surface, const RaisedCells *change, const double *was, Sums *sums) {
    const size_t own = change->first + surface->stride + 1;
    const double chance_was = surface->left_to_chance[own];
    double inside[THREE], height[THREE], square[THREE];
    load_cells(surface->inside + change->first, surface->stride, inside);
    for (size_t k = 0; k < THREE; k++) {
        const double above = was[k] - surface->reference;
        height[k] = inside[k] * change->raised[k];
        square[k] = height[k] * (above + change->raised[k] + above);
    }
    const double by_chance = surface->inside[own] * (change->chance * change->chance - chance_was * chance_was) / 3.0;
    sums->height += sum_of(height);
    sums->squared_height = sums->squared_height + sum_of(square) + by_chance;
}

/* Evaluates a change alone; dearer: increase of the cost of its cells. */
static INLINED void change_alone(const PlanSurface *surface, const RaisedCells *change, const Asked asked,
                                 ChangedCells *restrict cells, double *restrict dearer) {
    double was[THREE], chance[THREE], cost_was[THREE];
    load_cells(surface_height(surface, 1) + change->first, surface->stride, was);
    load_cells(surface->cost + change->first, surface->stride, cost_was);
    if (asked.chance) {
        load_cells(surface->left_to_chance + change->first, surface->stride, chance);
        for (size_t k = 0; k < THREE; k++)
            chance[k] = MIDDLE_LANES[k] > 0.0 ? change->chance : chance[k];
    }
    for (size_t k = 0; k < THREE; k++)
        cells->height[k] = was[k] + change->raised[k];
    costs_of(surface, change->first, cells->height, chance, cells->cost, asked);
    for (size_t k = 0; k < THREE; k++)
        dearer[k] = cells->cost[k] - cost_was[k];
    cells->chance = change->chance;
    cells->sums = (Sums){sum_of(dearer), 0.0, 0.0};
    if (!asked.cost_alone)
        add_heights(surface, change, was, &cells->sums);
}

static INLINED void alone(const PlanSurface *surface, const CellChange *change, const Asked asked,
                          ChangedCells *restrict cells) {
    RaisedCells raised;
    double dearer[THREE];
    raise_cells(surface, change, &raised);
    change_alone(surface, &raised, asked, cells, dearer);
}

static INLINED void first_of_two(const PlanSurface *surface, const CellChange *change, const Asked asked,
                                 FirstChange *restrict first) {
    RaisedCells raised;
    ChangedCells cells;
    double dearer[THREE];
    raise_cells(surface, change, &raised);
    change_alone(surface, &raised, asked, &cells, dearer);
    for (size_t row = 0; row < 3; row++) {
        for (size_t k = 0; k < LANES; k++)
            first->raised[(row + 1) * REACH_LANES + 1 + k] = raised.raised[row * LANES + k];
        for (size_t k = 0; k < LANES; k++)
            first->dearer[(row + 1) * REACH_LANES + 1 + k] = dearer[row * LANES + k];
    }
    first->chance = cells.chance;
    first->sums = cells.sums;
}

static INLINED Sums second_of_two(const PlanSurface *surface, const FirstChange *first, size_t near,
                                  const CellChange *change, const Asked asked) {
    RaisedCells own;
    double was[THREE], is[THREE], chance[THREE], cost_was[THREE], raised[THREE], dearer[THREE], is_own[THREE];
    double cost[THREE];
    raise_cells(surface, change, &own);
    load_cells(surface_height(surface, 1) + own.first, surface->stride, was);
    load_cells(surface->cost + own.first, surface->stride, cost_was);
    load_cells(first->raised + near, REACH_LANES, raised);
    load_cells(first->dearer + near, REACH_LANES, dearer);
    if (asked.chance) {
        load_cells(surface->left_to_chance + own.first, surface->stride, chance);
        load_cells(first->is_own + near, REACH_LANES, is_own);
        for (size_t k = 0; k < THREE; k++) {
            chance[k] = is_own[k] > 0.0 ? first->chance : chance[k];
            chance[k] = MIDDLE_LANES[k] > 0.0 ? own.chance : chance[k];
        }
    }
    for (size_t k = 0; k < THREE; k++) {
        was[k] += raised[k];
        is[k] = was[k] + own.raised[k];
    }
    costs_of(surface, own.first, is, chance, cost, asked);
    for (size_t k = 0; k < THREE; k++)
        cost[k] -= cost_was[k] + dearer[k];
    Sums sums = {first->sums.cost + sum_of(cost), first->sums.height, first->sums.squared_height};
    if (!asked.cost_alone)
        add_heights(surface, &own, was, &sums);
    return sums;
}

static void alone_plain(const PlanSurface *surface, const CellChange *change, bool cost_alone, ChangedCells *cells) {
    const Asked asked = asked_of(surface, cost_alone);
    if (is_cost_alone(&asked))
        alone(surface, change, COST_ALONE, cells);
    else
        alone(surface, change, asked, cells);
}

static WITH_AVX2 void alone_avx2(const PlanSurface *surface, const CellChange *change, bool cost_alone,
                                 ChangedCells *cells) {
    const Asked asked = asked_of(surface, cost_alone);
    if (is_cost_alone(&asked))
        alone(surface, change, COST_ALONE, cells);
    else
        alone(surface, change, asked, cells);
}

void look_at_change(const PlanSurface *surface, const CellChange *change, bool cost_alone, ChangedCells *cells) {
    (HAS_AVX2 ? alone_avx2 : alone_plain)(surface, change, cost_alone, cells);
}

static void first_plain(const PlanSurface *surface, const CellChange *change, bool cost_alone, FirstChange *first) {
    const Asked asked = asked_of(surface, cost_alone);
    if (is_cost_alone(&asked))
        first_of_two(surface, change, COST_ALONE, first);
    else
        first_of_two(surface, change, asked, first);
}

static WITH_AVX2 void first_avx2(const PlanSurface *surface, const CellChange *change, bool cost_alone,
                                 FirstChange *first) {
    const Asked asked = asked_of(surface, cost_alone);
    if (is_cost_alone(&asked))
        first_of_two(surface, change, COST_ALONE, first);
    else
        first_of_two(surface, change, asked, first);
}

void look_at_first(const PlanSurface *surface, const CellChange *change, bool cost_alone, FirstChange *first) {
    (HAS_AVX2 ? first_avx2 : first_plain)(surface, change, cost_alone, first);
}

static Sums second_plain(const PlanSurface *surface, const FirstChange *first, size_t near, const CellChange *change,
                         bool cost_alone) {
    const Asked asked = asked_of(surface, cost_alone);
    return is_cost_alone(&asked) ? second_of_two(surface, first, near, change, COST_ALONE)
                                 : second_of_two(surface, first, near, change, asked);
}

static WITH_AVX2 Sums second_avx2(const PlanSurface *surface, const FirstChange *first, size_t near,
                                  const CellChange *change, bool cost_alone) {
    const Asked asked = asked_of(surface, cost_alone);
    return is_cost_alone(&asked) ? second_of_two(surface, first, near, change, COST_ALONE)
                                 : second_of_two(surface, first, near, change, asked);
}

Sums look_at_second(const PlanSurface *surface, const FirstChange *first, size_t near, const CellChange *change,
                    bool cost_alone) {
    return (HAS_AVX2 ? second_avx2 : second_plain)(surface, first, near, change, cost_alone);
}

/* Writes the cells of the grid that the droplet reaches and no others, which another thread may use. */
void put_cells(PlanSurface *surface, const CellChange *change, const ChangedCells *cells) {
    const size_t top = change->i > 0 ? 0 : 1, bottom = change->i + 1 < surface->nx ? 2 : 1;
    const size_t left = change->j > 0 ? 0 : 1, right = change->j + 1 < surface->ny ? 2 : 1;
    const size_t first = change->i * surface->stride + change->j;
    double *last = surface_height(surface, 1) + first, *cost = surface->cost + first;
    if (surface->chance > 0.0) /* else the map stays 0, and its memory unused */
        surface->left_to_chance[first + surface->stride + 1] = cells->chance;
    for (size_t row = top; row <= bottom; row++)
        for (size_t column = left; column <= right; column++) {
            last[row * surface->stride + column] = cells->height[row * LANES + column];
            cost[row * surface->stride + column] = cells->cost[row * LANES + column];
        }
}
