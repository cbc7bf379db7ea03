#include "one_step_cells.h"

#include "instruction_sets.h"

/* Functions of their own for each set of instructions: gcc 12 keeps only so small ones in whole vectors. */

/* 1 for the cell in the middle. */
static const double MIDDLE_LANES[THREE] = {[MIDDLE] = 1.0};

const double NO_SHARES[THREE] = {0.0};

/* LANES cells of each of three rows of a map. */
static INLINED void load_cells(const double *map, size_t stride, double *restrict cells) {
    for (size_t row = 0; row < 3; row++) /* by name: a copy of bytes is done in pieces that do not fit a vector */
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
    for (size_t k = 0; k < THREE; k++) /* whole vectors: a number written into one would hold up its next reader */
        shares[k] = taken[k] + MIDDLE_LANES[k] * kept;
}

/* What counts: constants wherever a function is inlined, so that most of the trials have a short one. */
typedef struct {
    bool cost_alone, chance, ceiling;
} Asked;

static const Asked COST_ALONE = {true, false, false};

static inline Asked asked_of(const PlanSurface *surface, bool cost_alone) {
    return (Asked){cost_alone, surface->chance > 0.0, surface->ceiling != NULL};
}

static inline bool is_cost_alone(const Asked *asked) {
    return asked->cost_alone && !asked->chance && !asked->ceiling;
}

/* What the heights `is` cost, left to `chance`: see surface_cost. */
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

static INLINED void raise_of(const CellsChange *change, double *restrict raised) {
    for (size_t k = 0; k < THREE; k++)
        raised[k] = change->come[k] - change->gone[k];
}

/* Adds the change of heights and their squares to the sums. */
static INLINED void add_heights(const PlanSurface *surface, size_t first, const double *raised, const double *was,
                                double *restrict height, double *restrict square) {
    double inside[THREE];
    load_cells(surface->inside + first, surface->stride, inside);
    for (size_t k = 0; k < THREE; k++) {
        const double above = was[k] - surface->reference;
        height[k] = inside[k] * raised[k];
        square[k] = height[k] * (above + raised[k] + above);
    }
}

/* What the squares of a cell left to chance change by. */
static inline double square_of_chance(const PlanSurface *surface, const CellsChange *change, double chance) {
    const size_t cell = change->first + surface->stride + 1;
    const double was = surface->left_to_chance[cell];
    return surface->inside[cell] * (chance * chance - was * was) / 3.0;
}

/* Takes what a change raises and what it adds to the costs of its cells. */
static INLINED void put_first(const double *raised, const double *cost, double chance, FirstChange *restrict first) {
    for (size_t row = 0; row < 3; row++) {
        for (size_t k = 0; k < LANES; k++)
            first->raised[(row + 1) * REACH_LANES + 1 + k] = raised[row * LANES + k];
        for (size_t k = 0; k < LANES; k++)
            first->cost[(row + 1) * REACH_LANES + 1 + k] = cost[row * LANES + k];
    }
    first->chance = chance;
}

static INLINED Sums change_alone(const PlanSurface *surface, const CellsChange *change, const Asked asked,
                                 FirstChange *restrict first) {
    double was[THREE], is[THREE], chance[THREE], cost_was[THREE], raised[THREE], height[THREE], square[THREE];
    double cost[THREE];
    const double own = surface_chance(surface, change->come[MIDDLE]);
    raise_of(change, raised);
    load_cells(surface_height(surface, 1) + change->first, surface->stride, was);
    load_cells(surface->cost + change->first, surface->stride, cost_was);
    if (asked.chance) {
        load_cells(surface->left_to_chance + change->first, surface->stride, chance);
        for (size_t k = 0; k < THREE; k++)
            chance[k] = MIDDLE_LANES[k] > 0.0 ? own : chance[k];
    }
    for (size_t k = 0; k < THREE; k++)
        is[k] = was[k] + raised[k];
    costs_of(surface, change->first, is, chance, cost, asked);
    for (size_t k = 0; k < THREE; k++)
        cost[k] -= cost_was[k];
    if (first)
        put_first(raised, cost, own, first);
    if (asked.cost_alone)
        return (Sums){sum_of(cost), 0.0, 0.0};
    add_heights(surface, change->first, raised, was, height, square);
    return (Sums){sum_of(cost), sum_of(height), sum_of(square) + square_of_chance(surface, change, own)};
}

static INLINED Sums change_after(const PlanSurface *surface, const FirstChange *earlier, size_t near,
                                 const CellsChange *change, const Asked asked) {
    double was[THREE], is[THREE], chance[THREE], cost_was[THREE], raised[THREE], added[THREE], is_own[THREE];
    double own_raised[THREE], cost[THREE], height[THREE], square[THREE];
    const double own = surface_chance(surface, change->come[MIDDLE]);
    raise_of(change, own_raised);
    load_cells(surface_height(surface, 1) + change->first, surface->stride, was);
    load_cells(surface->cost + change->first, surface->stride, cost_was);
    load_cells(earlier->raised + near, REACH_LANES, raised);
    load_cells(earlier->cost + near, REACH_LANES, added);
    if (asked.chance) {
        load_cells(surface->left_to_chance + change->first, surface->stride, chance);
        load_cells(earlier->is_own + near, REACH_LANES, is_own);
        for (size_t k = 0; k < THREE; k++) {
            chance[k] = is_own[k] > 0.0 ? earlier->chance : chance[k];
            chance[k] = MIDDLE_LANES[k] > 0.0 ? own : chance[k];
        }
    }
    for (size_t k = 0; k < THREE; k++) {
        was[k] += raised[k];
        is[k] = was[k] + own_raised[k];
    }
    costs_of(surface, change->first, is, chance, cost, asked);
    for (size_t k = 0; k < THREE; k++)
        cost[k] -= cost_was[k] + added[k];
    if (asked.cost_alone)
        return (Sums){earlier->sums.cost + sum_of(cost), 0.0, 0.0};
    add_heights(surface, change->first, own_raised, was, height, square);
    return (Sums){earlier->sums.cost + sum_of(cost), earlier->sums.height + sum_of(height),
                  earlier->sums.squared_height + sum_of(square) + square_of_chance(surface, change, own)};
}

static void shares_plain(const PlanSurface *surface, size_t first, unsigned value, double *shares) {
    shares_of(surface, first, value, shares);
}

static WITH_AVX2 void shares_avx2(const PlanSurface *surface, size_t first, unsigned value, double *shares) {
    shares_of(surface, first, value, shares);
}

void take_shares(const PlanSurface *surface, size_t first, unsigned value, double *shares) {
    (HAS_AVX2 ? shares_avx2 : shares_plain)(surface, first, value, shares);
}

static Sums alone_plain(const PlanSurface *surface, const CellsChange *change, bool cost_alone) {
    const Asked asked = asked_of(surface, cost_alone);
    return is_cost_alone(&asked) ? change_alone(surface, change, COST_ALONE, NULL)
                                 : change_alone(surface, change, asked, NULL);
}

static WITH_AVX2 Sums alone_avx2(const PlanSurface *surface, const CellsChange *change, bool cost_alone) {
    const Asked asked = asked_of(surface, cost_alone);
    return is_cost_alone(&asked) ? change_alone(surface, change, COST_ALONE, NULL)
                                 : change_alone(surface, change, asked, NULL);
}

Sums look_at_change(const PlanSurface *surface, const CellsChange *change, bool cost_alone) {
    return (HAS_AVX2 ? alone_avx2 : alone_plain)(surface, change, cost_alone);
}

static void first_plain(const PlanSurface *surface, const CellsChange *change, bool cost_alone, FirstChange *first) {
    const Asked asked = asked_of(surface, cost_alone);
    first->sums = is_cost_alone(&asked) ? change_alone(surface, change, COST_ALONE, first)
                                        : change_alone(surface, change, asked, first);
}

static WITH_AVX2 void first_avx2(const PlanSurface *surface, const CellsChange *change, bool cost_alone,
                                 FirstChange *first) {
    const Asked asked = asked_of(surface, cost_alone);
    first->sums = is_cost_alone(&asked) ? change_alone(surface, change, COST_ALONE, first)
                                        : change_alone(surface, change, asked, first);
}

void look_at_first(const PlanSurface *surface, const CellsChange *change, bool cost_alone, FirstChange *first) {
    (HAS_AVX2 ? first_avx2 : first_plain)(surface, change, cost_alone, first);
}

static Sums after_plain(const PlanSurface *surface, const FirstChange *earlier, size_t near, const CellsChange *change,
                        bool cost_alone) {
    const Asked asked = asked_of(surface, cost_alone);
    return is_cost_alone(&asked) ? change_after(surface, earlier, near, change, COST_ALONE)
                                 : change_after(surface, earlier, near, change, asked);
}

static WITH_AVX2 Sums after_avx2(const PlanSurface *surface, const FirstChange *earlier, size_t near,
                                 const CellsChange *change, bool cost_alone) {
    const Asked asked = asked_of(surface, cost_alone);
    return is_cost_alone(&asked) ? change_after(surface, earlier, near, change, COST_ALONE)
                                 : change_after(surface, earlier, near, change, asked);
}

Sums look_at_second(const PlanSurface *surface, const FirstChange *earlier, size_t near, const CellsChange *change,
                    bool cost_alone) {
    return (HAS_AVX2 ? after_avx2 : after_plain)(surface, earlier, near, change, cost_alone);
}
