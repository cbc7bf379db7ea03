#include "flip_costs.h"

#include "instruction_sets.h"

static INLINED float between_floats(float low, float value, float high) {
    const float raised = value > low ? value : low;
    return raised < high ? raised : high;
}

FlipPrices flip_prices(const PlanSurface *surface, float most) {
    const Droplet *droplet = &surface->droplet[1];
    return (FlipPrices){.volume = (float)droplet->volume,
                        .spread = {(float)droplet->spread[SIDE], (float)droplet->spread[CORNER]},
                        .slope = {(float)droplet->slope[SIDE], (float)droplet->slope[CORNER]},
                        .reach = (float)(2.0 * droplet->volume),
                        .overshoot = (float)(surface->upward + surface->skew),
                        .upward = (float)surface->upward,
                        .ceiling_cost = (float)surface->problem->ceiling_cost,
                        .chance = (float)surface->chance,
                        .least_chance = (float)surface->least_chance,
                        .most = most};
}

/* Terms of a cost besides the error: constants wherever a function is inlined. */
typedef struct {
    bool chance, ceiling;
} Counted;

/* Cost of an error after the step on a cell of weight 1 [m]: see surface_cost. */
static INLINED float cost_of(const FlipPrices *prices, float error, float above, float chance, const Counted counted) {
    const float high = prices->overshoot * error, low = -error, size = fabsf(error);
    const float safe = counted.chance && chance > 0.0f ? chance : 1.0f;
    const float more = 0.5f * (size * size / safe + chance) - size;
    const float by_chance = counted.chance ? prices->upward * (size < chance ? more : 0.0f) : 0.0f;
    const float by_ceiling = counted.ceiling ? prices->ceiling_cost * (above > 0.0f ? above : 0.0f) : 0.0f;
    return (high > low ? high : low) + by_chance + by_ceiling;
}

enum { ROW = FLIPS_MAX + 2, VECTOR = 8 };

/* The present errors of cells of a row, one more at either end, and their costs. */
typedef struct {
    float error[ROW], above[ROW], chance[ROW], weight[ROW], cost[ROW];
} ErrorRow;

/* Flips of cells of a row: height that each droplet leaves on its own cell, sign (+1 to jet, -1 to remove), and
 * cost. */
typedef struct {
    float kept[FLIPS_MAX], sign[FLIPS_MAX], cost[FLIPS_MAX];
} FlipRow;

/* The error, clipped: beyond the limits the cost is linear. */
static INLINED float clipped(const FlipPrices *prices, double error) {
    return between_floats(-prices->reach, (float)error, prices->reach);
}

/* Loads the errors of cells of the map from `cell` on; `from`: the first of them in the row. */
static INLINED void load_errors(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count,
                                const Counted counted, size_t from, ErrorRow *row) {
    const double *height = surface_height(surface, 1) + cell, *target = surface->target + cell;
    const double *weight = surface->weight + cell, *chance = surface->left_to_chance + cell;
    const double *ceiling = counted.ceiling ? surface->ceiling + cell : target;
    float *restrict its_error = row->error + from, *restrict its_above = row->above + from;
    float *restrict its_chance = row->chance + from, *restrict its_weight = row->weight + from;
    float *restrict its_cost = row->cost + from;
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const float error = clipped(prices, height[k] - target[k]);
        const float above = counted.ceiling ? clipped(prices, height[k] - ceiling[k]) : 0.0f;
        const float left = counted.chance ? (float)chance[k] : 0.0f, heavy = (float)weight[k];
        its_error[k] = error;
        its_weight[k] = heavy;
        its_cost[k] = heavy * cost_of(prices, error, above, left, counted);
        if (counted.ceiling)
            its_above[k] = above;
        if (counted.chance)
            its_chance[k] = left;
    }
}

/* Cost of a neighbour after a change of its height. */
static INLINED float neighbour_cost(const FlipPrices *prices, const ErrorRow *row, size_t k, float change,
                                    const Counted counted) {
    const float above = counted.ceiling ? row->above[k] + change : 0.0f;
    return row->weight[k] *
           cost_of(prices, row->error[k] + change, above, counted.chance ? row->chance[k] : 0.0f, counted);
}

/* Share that a neighbour takes [m]. */
static INLINED float share(const FlipPrices *prices, size_t place, double rise) {
    return between_floats(0.0f, prices->spread[place] + prices->slope[place] * (float)rise, prices->spread[place]);
}

/* Adds the effects of the flips of the cells `here` on their neighbours `there` in the row above or below. */
static INLINED void add_row(const FlipPrices *prices, const double *here, const double *there, size_t count,
                            const ErrorRow *row, const Counted counted, FlipRow *flips) {
    float *restrict kept = flips->kept, *restrict cost = flips->cost;
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const float left = share(prices, CORNER, here[k] - there[k - 1]);
        const float straight = share(prices, SIDE, here[k] - there[k]);
        const float right = share(prices, CORNER, here[k] - there[k + 1]);
        const float sign = flips->sign[k];
        kept[k] -= left + straight + right;
        cost[k] += neighbour_cost(prices, row, k, sign * left, counted) +
                   neighbour_cost(prices, row, k + 1, sign * straight, counted) +
                   neighbour_cost(prices, row, k + 2, sign * right, counted);
    }
}

/* Adds the effects in their own row, on the cells themselves as well. */
static INLINED void add_own_row(const FlipPrices *prices, const double *here, size_t count, const ErrorRow *row,
                                const Counted counted, FlipRow *flips) {
    float *restrict cost = flips->cost;
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const float left = share(prices, SIDE, here[k] - here[k - 1]);
        const float right = share(prices, SIDE, here[k] - here[k + 1]);
        const float sign = flips->sign[k], kept = flips->kept[k] - left - right;
        const float own = prices->chance * (sign > 0.0f ? kept : 0.0f);
        const float chance = own > prices->least_chance ? own : prices->least_chance;
        const float above = counted.ceiling ? row->above[k + 1] + sign * kept : 0.0f;
        cost[k] += neighbour_cost(prices, row, k, sign * left, counted) +
                   neighbour_cost(prices, row, k + 2, sign * right, counted) +
                   row->weight[k + 1] * cost_of(prices, row->error[k + 1] + sign * kept, above, chance, counted);
    }
}

/* Loads the errors of a row from one cell before `cell` to one behind the last. */
static INLINED void load_row(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count,
                             const Counted counted, ErrorRow *row) {
    if (count % VECTOR == 0) { /* some cells twice: whole vectors only */
        load_errors(prices, surface, cell - 1, count, counted, 0, row);
        load_errors(prices, surface, cell + count + 1 - VECTOR, VECTOR, counted, count + 2 - VECTOR, row);
    } else {
        load_errors(prices, surface, cell - 1, count + 2, counted, 0, row);
    }
}

static INLINED void read_cells(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count,
                               const Counted counted, float *restrict least) {
    const uint8_t *plan = surface_layer(surface, 0) + cell;
    const double *here = surface_height(surface, 0) + cell;
    const float volume = prices->volume, most = prices->most;
    ErrorRow above, own, below;
    FlipRow flips;
    load_row(prices, surface, cell - surface->stride, count, counted, &above);
    load_row(prices, surface, cell, count, counted, &own);
    load_row(prices, surface, cell + surface->stride, count, counted, &below);
    AS_LOOP for (size_t k = 0; k < count; k++) {
        flips.kept[k] = volume;
        flips.sign[k] = plan[k] ? -1.0f : 1.0f;
        flips.cost[k] = -(above.cost[k] + own.cost[k] + below.cost[k]) -
                        (above.cost[k + 1] + own.cost[k + 1] + below.cost[k + 1]) -
                        (above.cost[k + 2] + own.cost[k + 2] + below.cost[k + 2]);
    }
    add_row(prices, here, here - surface->stride, count, &above, counted, &flips);
    add_row(prices, here, here + surface->stride, count, &below, counted, &flips);
    add_own_row(prices, here, count, &own, counted, &flips);
    AS_LOOP for (size_t k = 0; k < count; k++) { /* NaN stays */
        const float found = flips.cost[k];
        least[k] = found > most ? most : found;
    }
}

static INLINED void read_any(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count,
                             float *least) {
    static const Counted NOTHING = {false, false}, CHANCE = {true, false}, CEILING = {false, true}, BOTH = {true, true};
    if (surface->chance > 0.0 && surface->ceiling)
        read_cells(prices, surface, cell, count, BOTH, least);
    else if (surface->chance > 0.0)
        read_cells(prices, surface, cell, count, CHANCE, least);
    else if (surface->ceiling)
        read_cells(prices, surface, cell, count, CEILING, least);
    else
        read_cells(prices, surface, cell, count, NOTHING, least);
}

/* Reads all rows, whose length is mostly a multiple of the vector length, which gcc can see. */
static INLINED void read_all(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count,
                             float *least) {
    if (count % VECTOR == 0)
        read_any(prices, surface, cell, count / VECTOR * VECTOR, least);
    else
        read_any(prices, surface, cell, count, least);
}

static void read_plain(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count, float *least) {
    read_all(prices, surface, cell, count, least);
}

static WITH_AVX2 void read_avx2(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count,
                                float *least) {
    read_all(prices, surface, cell, count, least);
}

void flip_costs_read(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count, float *least) {
    (HAS_AVX2 ? read_avx2 : read_plain)(prices, surface, cell, count, least);
}
