#include "change_bound.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Bound of the rounding in a step in sum, as a share of the largest difference. 49 cells have 8 pairs each; a pair and
 * the sums that it enters are rounded by less than 12 times 2^-24 of that difference, times a slope below 1/4: 7e-5 at
 * most. */
static const double ROUNDING = 1e-4;

static const double DROPLET_OF_MOST = 0.25; /* the largest droplet, as a share of the largest difference */

enum { LEAST_STEPS = 2 }; /* least number of steps: fewer are tried as quickly (by trial) */

/* 1 for cells in sight; the lane behind each row of near cells is no cell. */
static const float IN_SIGHT[NEAR_LANES] = {1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 0.0f};

/* Differences of heights as they propagate, from cell NEAR_MARGIN on. */
typedef struct {
    float before[NEAR_MAP], after[NEAR_MAP];
    float left[NEAR_LANES];   /* sum of the differences out of sight, by lanes [m] */
    float chance[NEAR_CELLS]; /* uncertainty after the last step [m] */
    float most;               /* the largest difference after the last step [m] */
    size_t top, bottom;       /* rows with differences; bottom excluded */
} Spread;

bool bound_open(ChangeBound *bound, const PlanSurface *surface) {
    double weight = 0.0;
    *bound = (ChangeBound){.is_known = false};
    if (surface->steps < LEAST_STEPS || !near_rules(surface, &bound->rules))
        return true;
    if (!near_open(surface, &bound->rules, &bound->maps)) {
        bound_close(bound);
        return false;
    }
    float **map[] = {&bound->error,  &bound->above,  &bound->height, &bound->weight,
                     &bound->inside, &bound->chance, &bound->cost};
    const size_t count = sizeof map / sizeof *map, cells = bound->maps.rows * bound->maps.stride;
    float *next = bound->memory = calloc(count * cells, sizeof(float));
    for (size_t k = 0; next && k < count; k++, next += cells)
        *map[k] = next;
    for (size_t cell = 0; cell < surface->framed; cell++)
        weight = fmax(weight, surface->weight[cell]);
    const double steep = surface->upward + fabs(surface->skew);
    bound->cost_slope = weight * (steep + (surface->ceiling ? surface->problem->ceiling_cost : 0.0));
    /* half of the slope times twice the differences out of sight */
    bound->chance_slope = weight * surface->upward * surface->chance;
    return next != NULL;
}

void bound_close(ChangeBound *bound) {
    near_close(&bound->maps);
    free(bound->memory);
    bound->memory = NULL;
}

/* Adds the costs of cells as in surface_cost. */
static INLINED void add_costs(const PlanSurface *surface, const float *restrict error, const float *restrict above,
                              const float *restrict chance, const float *restrict weight, size_t count,
                              float *restrict cost) {
    const float upward = (float)surface->upward, skew = (float)surface->skew;
    const float steep = surface->ceiling ? (float)surface->problem->ceiling_cost : 0.0f;
    AS_LOOP for (size_t k = 0; k < count; k++) {
        const float size = fabsf(error[k]), safe = larger_of(chance[k], 1e-30f);
        const float near = 0.5f * (size * size / safe + chance[k]), expected = size < chance[k] ? near : size;
        cost[k] += weight[k] * (upward * expected + skew * error[k] + steep * larger_of(above[k], 0.0f));
    }
}

static size_t least_of(size_t a, size_t b) {
    return a < b ? a : b;
}

/* Height of a cell of the part above or below the reference; 0 outside. */
static INLINED double height_off(const PlanSurface *surface, const double *last, size_t cell) {
    return surface->inside[cell] * fabs(last[cell] - surface->reference);
}

/* Largest distance from the reference of the cells of the part in rows and columns of the grid. No other cells are
 * read: threads of other tiles may write them. */
static INLINED double highest(const PlanSurface *surface, size_t top, size_t bottom, size_t left, size_t right) {
    enum { WIDTH = 4 }; /* columns read together */
    const double *last = surface_height(surface, surface->steps);
    double most[WIDTH] = {0.0};
    for (size_t row = top; row < bottom; row++) {
        size_t cell = surface_cell(surface, row, left);
        const size_t end = surface_cell(surface, row, right);
        for (; cell + WIDTH <= end; cell += WIDTH)
            for (size_t k = 0; k < WIDTH; k++) {
                const double height = height_off(surface, last, cell + k);
                most[k] = height > most[k] ? height : most[k];
            }
        for (size_t k = 0; cell + k < end; k++) {
            const double height = height_off(surface, last, cell + k);
            most[k] = height > most[k] ? height : most[k];
        }
    }
    return fmax(fmax(most[0], most[1]), fmax(most[2], most[3]));
}

static double highest_of_tile(const PlanSurface *surface, const Tile *tile) {
    const size_t reach = surface->steps + 2;
    return highest(surface, tile->top > reach ? tile->top - reach : 0, least_of(surface->nx, tile->bottom + reach),
                   tile->left > reach ? tile->left - reach : 0, least_of(surface->ny, tile->right + reach));
}

void bound_begin(ChangeBound *bound, const PlanSurface *surface, const Tile *tile) {
    if (!bound->memory)
        return;
    if (!bound->is_known || memcmp(&bound->tile, tile, sizeof *tile) != 0) {
        near_begin(&bound->maps, tile);
        bound->top = bound->bottom = 0;
    }
    bound->is_known = true;
    bound->tile = *tile;
    bound->height_most = surface->weighting.alpha == 1.0 ? 0.0 : highest_of_tile(surface, tile);
}

/* Reads adjacent cells of the surface's maps into these maps. An error beyond twice the largest difference may be
 * replaced by any other of its sign. */
static INLINED void read_last(const PlanSurface *surface, ChangeBound *bound, size_t cell, size_t there, size_t count) {
    const double *last = surface_height(surface, surface->steps) + cell, *target = surface->target + cell;
    const double *weight = surface->weight + cell, *inside = surface->inside + cell;
    const double *chance = surface->left_to_chance + cell, reference = surface->reference;
    const float most = 2.0f * bound->rules.most;
    float *restrict error = bound->error + there, *restrict above = bound->above + there;
    float *restrict height = bound->height + there, *restrict weights = bound->weight + there;
    float *restrict insides = bound->inside + there, *restrict chances = bound->chance + there;
    for (size_t k = 0; k < count; k++) {
        error[k] = within(-most, (float)(last[k] - target[k]), most);
        above[k] = -most;
        height[k] = (float)(last[k] - reference);
        weights[k] = (float)weight[k];
        insides[k] = (float)inside[k];
        chances[k] = (float)chance[k];
    }
    for (size_t k = 0; surface->ceiling && k < count; k++)
        above[k] = within(-most, (float)(last[k] - surface->ceiling[cell + k]), most);
    memset(bound->cost + there, 0, count * sizeof(float));
    add_costs(surface, error, above, chances, weights, count, bound->cost + there);
}

/* The box of these maps on the surface's maps. */
static INLINED void read_box(const PlanSurface *surface, ChangeBound *bound, const Box *box) {
    const NearMaps *maps = &bound->maps;
    const ptrdiff_t left = box->left + maps->left > 0 ? box->left : -maps->left, end = (ptrdiff_t)surface->stride;
    const ptrdiff_t right = box->right + maps->left < end ? box->right : end - 1 - maps->left;
    for (ptrdiff_t row = box->top; left <= right && row <= box->bottom; row++) {
        const ptrdiff_t own = row + maps->top, there = row * (ptrdiff_t)maps->stride;
        const size_t cell = (size_t)(own * (ptrdiff_t)surface->stride + left + maps->left);
        if (own >= 0 && own < (ptrdiff_t)surface->nx + 2)
            read_last(surface, bound, cell, (size_t)(there + left), (size_t)(right - left) + 1);
        else
            memset(bound->weight + there, 0, maps->stride * sizeof(float));
    }
}

static void read_plain(const PlanSurface *surface, ChangeBound *bound, const Box *box) {
    read_box(surface, bound, box);
}

static WITH_AVX2 void read_avx2(const PlanSurface *surface, ChangeBound *bound, const Box *box) {
    read_box(surface, bound, box);
}

/* Reads those rows near row `i` of the grid that have not been read. */
static void read_rows(ChangeBound *bound, const PlanSurface *surface, size_t i) {
    const ptrdiff_t first = (ptrdiff_t)(i + 1) - NEAR_REACH - bound->maps.top, end = first + NEAR_ROWS;
    const bool begins = first < bound->top || first > bound->bottom || bound->top == bound->bottom;
    if (!begins && end <= bound->bottom)
        return;
    if (begins)
        bound->top = bound->bottom = first;
    const Box box = {bound->bottom, end - 1, 0, (ptrdiff_t)bound->maps.stride - 1};
    near_read(surface, &bound->rules, &bound->maps, &box, begins ? first - 1 : bound->bottom);
    (HAS_AVX2 ? read_avx2 : read_plain)(surface, bound, &box);
    bound->bottom = end;
}

static ptrdiff_t lower_of(ptrdiff_t a, ptrdiff_t b) {
    return a < b ? a : b;
}

static ptrdiff_t higher_of(ptrdiff_t a, ptrdiff_t b) {
    return a > b ? a : b;
}

/* Updates the maps in a changed box; pairs with changed cells change, too. Rows that were not read are read later. */
void bound_change(ChangeBound *bound, const PlanSurface *surface, const Box *changed) {
    const NearMaps *maps = &bound->maps;
    if (!bound->memory || box_is_empty(changed))
        return;
    const ptrdiff_t above = changed->top - maps->top - 1, last = bound->bottom - 1;
    const Box box = {higher_of(bound->top, above), lower_of(last, changed->bottom - maps->top + 1),
                     higher_of(0, changed->left - maps->left - 1),
                     lower_of((ptrdiff_t)maps->stride - 1, changed->right - maps->left + 1)};
    if (surface->weighting.alpha < 1.0)
        bound->height_most =
            fmax(bound->height_most, highest(surface, (size_t)changed->top - 1, (size_t)changed->bottom,
                                             (size_t)changed->left - 1, (size_t)changed->right));
    if (box_is_empty(&box) || box.left > box.right)
        return;
    near_read(surface, &bound->rules, maps, &box, higher_of(bound->top - 1, above));
    (HAS_AVX2 ? read_avx2 : read_plain)(surface, bound, &box);
}

enum { SHARE_LANES = 4, SHARES = 3 * SHARE_LANES }; /* nine cells of a droplet, a lane behind each row */

/* Adds the shares of a droplet on a near cell `sign` times, `after` being the first of its nine cells; returns the
 * height it leaves on its own cell [m]. */
static INLINED double add_droplet(const Droplet *droplet, const double *restrict heights, float sign,
                                  float *restrict after) {
    const double own = heights[SHARE_LANES + 1];
    double kept = droplet->volume, taken[SHARES];
    for (size_t row = 0; row < 3; row++)
        for (size_t k = 0; k < SHARE_LANES; k++)
            taken[row * SHARE_LANES + k] = flow(droplet->spread_lanes[row][k + 1], droplet->slope_lanes[row][k + 1],
                                                own - heights[row * SHARE_LANES + k]);
    for (size_t row = 0; row < 3; row++)
        for (size_t k = 0; k < 3; k++)
            kept -= taken[row * SHARE_LANES + k];
    for (size_t row = 0; row < 3; row++)
        for (size_t k = 0; k < SHARE_LANES; k++)
            after[row * NEAR_LANES + k] += sign * (float)taken[row * SHARE_LANES + k];
    after[NEAR_LANES + 1] += sign * (float)kept;
    return kept;
}

/* Replaces the old droplet by the new one; (i, j): the cell in the middle. */
static INLINED void make_change(const PlanSurface *surface, size_t i, size_t j, const Change *change, size_t number,
                                Spread *spread) {
    const size_t row = change->i + NEAR_REACH - i, lane = change->j + NEAR_REACH - j;
    const size_t first = NEAR_MARGIN + (row - 1) * NEAR_LANES + lane - 1;
    const size_t cell = surface_cell(surface, change->i, change->j);
    const unsigned value = surface_layer(surface, change->layer)[cell];
    const double *map = surface_height(surface, number) + cell - (surface->stride + 1);
    double heights[SHARES], kept = 0.0;
    for (size_t line = 0; line < 3; line++)
        for (size_t k = 0; k < SHARE_LANES; k++)
            heights[line * SHARE_LANES + k] =
                map[line * surface->stride + k] + (double)spread->before[first + line * NEAR_LANES + k];
    if (value)
        add_droplet(&surface->droplet[value], heights, -1.0f, spread->after + first);
    if (change->value)
        kept = add_droplet(&surface->droplet[change->value], heights, 1.0f, spread->after + first);
    if (number + 1 == surface->steps)
        spread->chance[row * NEAR_LANES + lane] = (float)surface_chance(surface, kept);
    spread->top = least_of(spread->top, row - 1);
    spread->bottom = spread->bottom > row + 2 ? spread->bottom : row + 2;
}

/* Propagates the differences through one step; view: first of the near cells in the maps. */
static INLINED void carry(const PlanSurface *surface, const ChangeBound *bound, size_t number, size_t view,
                          bool is_mixed, bool is_last, Spread *spread) {
    spread->top -= spread->top > 0;
    spread->bottom += spread->bottom < NEAR_ROWS;
    const NearStep *step = &bound->maps.step[number];
    const size_t begin = NEAR_MARGIN + spread->top * NEAR_LANES, stride = bound->maps.stride;
    const float share = (float)surface->chance, least = (float)surface->least_chance;
    memcpy(spread->before + begin, spread->after + begin, (spread->bottom - spread->top) * NEAR_LANES * sizeof(float));
    for (size_t row = spread->top; row < spread->bottom; row++) {
        const size_t here = view + row * stride, near = row * NEAR_LANES;
        const float *before = spread->before + NEAR_MARGIN + near;
        /* separate arrays: they do not alias an input */
        float after[NEAR_LANES], away[NEAR_LANES], chance[NEAR_LANES];
        AS_LOOP for (size_t k = 0; k < NEAR_LANES; k++) {
            float given;
            const float lost = near_loss(step, bound->rules.slope, is_mixed, is_last, (ptrdiff_t)(here + k),
                                         (ptrdiff_t)stride, before + k, &given);
            away[k] = bound->rules.leaving[near + k] * fabsf(before[k]);
            after[k] = IN_SIGHT[k] * (before[k] - (lost - step->lost[here + k]));
            if (is_last)
                chance[k] = larger_of(bound->chance[here + k] - share * (given - step->given[here + k]), least);
        }
        AS_LOOP for (size_t k = 0; k < NEAR_LANES; k++) {
            spread->left[k] += away[k];
            spread->after[NEAR_MARGIN + near + k] = after[k];
            if (is_last)
                spread->chance[near + k] = chance[k];
        }
    }
}

/* Change of the sums by the differences after the last step. */
static INLINED Sums added_sums(const PlanSurface *surface, const ChangeBound *bound, size_t view, Spread *spread) {
    float sums[3][NEAR_LANES] = {{0.0f}}, most[NEAR_LANES] = {0.0f};
    for (size_t row = spread->top; row < spread->bottom; row++) {
        const size_t here = view + row * bound->maps.stride;
        const float *after = spread->after + NEAR_MARGIN + row * NEAR_LANES;
        const float *chance = spread->chance + row * NEAR_LANES, *was = bound->chance + here;
        const float *inside = bound->inside + here, *high = bound->height + here;
        float error[NEAR_LANES], above[NEAR_LANES], cost[NEAR_LANES];
        AS_LOOP for (size_t k = 0; k < NEAR_LANES; k++) {
            error[k] = bound->error[here + k] + after[k];
            above[k] = bound->above[here + k] + after[k];
            cost[k] = -bound->cost[here + k];
        }
        add_costs(surface, error, above, chance, bound->weight + here, NEAR_LANES, cost);
        AS_LOOP for (size_t k = 0; k < NEAR_LANES; k++) {
            const float squares = after[k] * (2.0f * high[k] + after[k]);
            const float chances = (chance[k] - was[k]) * (chance[k] + was[k]) * (1.0f / 3.0f);
            most[k] = larger_of(most[k], fabsf(after[k]));
            sums[0][k] += IN_SIGHT[k] * cost[k];
            sums[1][k] += inside[k] * after[k];
            sums[2][k] += IN_SIGHT[k] * inside[k] * (squares + chances);
        }
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

static INLINED void spread_changes(const PlanSurface *surface, const ChangeBound *bound, size_t i, size_t j,
                                   const Change *change, size_t count, size_t first, Spread *spread, Sums *added) {
    const float zero = bound->rules.none; /* by name: the processor fills such small arrays slowly */
    const size_t view = near_first(&bound->maps, i, j);
    const bool is_mixed = bound->rules.is_mixed;
    for (size_t k = 0; k < NEAR_MAP; k++)
        spread->before[k] = spread->after[k] = zero;
    for (size_t k = 0; k < NEAR_LANES; k++)
        spread->left[k] = zero;
    for (size_t row = 0; row < NEAR_ROWS; row++)
        for (size_t k = 0; k < NEAR_LANES; k++)
            spread->chance[row * NEAR_LANES + k] = bound->chance[view + row * bound->maps.stride + k];
    spread->top = NEAR_ROWS;
    spread->bottom = 0;
    for (size_t number = first; number < surface->steps; number++) {
        const bool is_last = number + 1 == surface->steps;
        if (spread->bottom > 0 && is_mixed && is_last)
            carry(surface, bound, number, view, true, true, spread);
        else if (spread->bottom > 0 && is_mixed)
            carry(surface, bound, number, view, true, false, spread);
        else if (spread->bottom > 0 && is_last)
            carry(surface, bound, number, view, false, true, spread);
        else if (spread->bottom > 0)
            carry(surface, bound, number, view, false, false, spread);
        for (size_t k = 0; k < count; k++)
            if (surface_step(surface, change[k].layer, change[k].i, change[k].j) == number)
                make_change(surface, i, j, &change[k], number, spread);
    }
    *added = added_sums(surface, bound, view, spread);
}

static void spread_plain(const PlanSurface *surface, const ChangeBound *bound, size_t i, size_t j, const Change *change,
                         size_t count, size_t first, Spread *spread, Sums *added) {
    spread_changes(surface, bound, i, j, change, count, first, spread, added);
}

static WITH_AVX2 void spread_avx2(const PlanSurface *surface, const ChangeBound *bound, size_t i, size_t j,
                                  const Change *change, size_t count, size_t first, Spread *spread, Sums *added) {
    spread_changes(surface, bound, i, j, change, count, first, spread, added);
}

double change_bound(ChangeBound *bound, const PlanSurface *surface, size_t i, size_t j, const Change *change,
                    size_t count, const Sums *sums) {
    const Weighting *weighting = &surface->weighting;
    Spread spread;
    Sums added;
    if (!bound->memory)
        return -INFINITY;
    size_t first = surface->steps;
    for (size_t k = 0; k < count; k++)
        first = least_of(first, surface_step(surface, change[k].layer, change[k].i, change[k].j));
    if (surface->steps < first + LEAST_STEPS)
        return -INFINITY;
    read_rows(bound, surface, i);
    (HAS_AVX2 ? spread_avx2 : spread_plain)(surface, bound, i, j, change, count, first, &spread, &added);
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
