#include "near_flow.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double ABYSS = -1.0; /* height of cells outside the grid, as deep as the frame [m] */

static const double SAME_SLOPE = 1e-7; /* relative difference below which slopes count as equal (assumed) */

/* Cells of the maps around those of a tile: near ones, one more where pairs begin, and lanes behind. */
enum { ROWS_AROUND = 2 * NEAR_REACH + 2, COLUMNS_AROUND = NEAR_REACH + NEAR_LANES + 1 };
enum { LINE = TILE + COLUMNS_AROUND + 2, HEAD = 16 };

/* A row of cells, with one more on each side: cell k of the maps at 1 + k. */
typedef struct {
    double height[LINE];
    float width[2][LINE], slope[2][LINE];
} Line;

bool near_rules(const PlanSurface *surface, NearRules *rules) {
    double steepest[2] = {0.0, 0.0}, largest = 0.0;
    *rules = (NearRules){.is_mixed = false};
    for (size_t value = 1; value <= surface->problem->kinds; value++) {
        const Droplet *droplet = &surface->droplet[value], *first = &surface->droplet[1];
        largest = fmax(largest, droplet->volume);
        for (int place = SIDE; place <= CORNER; place++) {
            const double slope = droplet->slope[place];
            rules->slopes[place][value] = (float)slope;
            rules->widths[place][value] = slope > 0.0 ? (float)(droplet->spread[place] / slope) : 0.0f;
            rules->is_mixed = rules->is_mixed || fabs(slope - first->slope[place]) > SAME_SLOPE * slope;
            steepest[place] = fmax(steepest[place], slope);
        }
    }
    for (int place = SIDE; place <= CORNER; place++)
        rules->slope[place] = (float)steepest[place];
    rules->most = (float)(4.0 * largest); /* two droplets are added and two removed */
    for (size_t row = 0; row < NEAR_ROWS; row++)
        for (size_t lane = 0; lane < NEAR_ROWS; lane++) {
            const bool ends_row = row == 0 || row + 1 == NEAR_ROWS, ends_lane = lane == 0 || lane + 1 == NEAR_ROWS;
            const double corners = ends_row && ends_lane ? 3.0 : ends_row || ends_lane ? 2.0 : 0.0;
            const double leaving = (ends_row + ends_lane) * steepest[SIDE] + corners * steepest[CORNER];
            rules->leaving[row * NEAR_LANES + lane] = (float)leaving;
        }
    return 4.0 * (steepest[SIDE] + steepest[CORNER]) < 1.0;
}

static size_t least_of(size_t a, size_t b) {
    return a < b ? a : b;
}

/* Assigns memory of `cells` cells to each of `count` maps. */
static void take(float **next, size_t cells, float **map, size_t count) {
    for (size_t k = 0; k < count; k++, *next += cells)
        map[k] = *next;
}

bool near_open(const PlanSurface *surface, const NearRules *rules, NearMaps *maps) {
    const size_t pairs = NEAR_PAIRS, mixed = rules->is_mixed ? 3 * pairs : 0;
    *maps = (NearMaps){.rows = least_of(surface->nx, TILE) + ROWS_AROUND,
                       .stride = least_of(surface->ny, TILE) + COLUMNS_AROUND};
    const size_t cells = maps->rows * maps->stride, count = (surface->steps - 1) * (2 * pairs + 1 + mixed) + pairs + 1;
    maps->step = calloc(surface->steps, sizeof(NearStep));
    maps->memory = calloc(HEAD + count * cells, sizeof(float));
    if (!maps->step || !maps->memory)
        return false;
    float *next = (float *)maps->memory + HEAD;
    for (size_t number = 1; number < surface->steps; number++) {
        NearStep *step = &maps->step[number];
        const bool is_last = number + 1 == surface->steps;
        take(&next, cells, step->low, pairs);
        take(&next, cells, step->high, pairs);
        take(&next, cells, &step->lost, 1);
        if (rules->is_mixed || is_last)
            take(&next, cells, step->kink, pairs);
        if (is_last)
            take(&next, cells, &step->given, 1);
        if (rules->is_mixed) {
            take(&next, cells, step->give, pairs);
            take(&next, cells, step->take, pairs);
        }
    }
    return true;
}

void near_close(NearMaps *maps) {
    free(maps->step);
    free(maps->memory);
    *maps = (NearMaps){.step = NULL};
}

static INLINED void load_values(const float *of, size_t kinds, const uint8_t *restrict value, size_t count,
                                float *restrict cells) {
    for (size_t k = 0; k < count; k++)
        cells[k] = 0.0f;
    for (uint8_t kind = 1; kind <= kinds; kind++) {
        const float own = of[kind];
        for (size_t k = 0; k < count; k++)
            cells[k] = value[k] == kind ? own : cells[k];
    }
}

/* Values jetted in the step on cells of a row of the surface's maps. */
static INLINED void copy_values(const PlanSurface *surface, size_t number, size_t row, size_t column, size_t count,
                                uint8_t *restrict cells) {
    const size_t passes = (size_t)surface->problem->passes, layer = number / passes;
    memcpy(cells, surface_layer(surface, layer) + row * surface->stride + column, count);
    if (passes == 1)
        return;
    const int32_t colour = surface->problem->colours[layer][number % passes];
    for (size_t k = 0; k < count; k++) /* the frame has values 0, whatever its colour */
        cells[k] = colour == cell_colour(row + 1, column + k + 1) ? cells[k] : 0;
}

/* Row `row` of the maps, with a cell more before column `first` and behind column `last`. */
static INLINED void load_line(const PlanSurface *surface, const NearRules *rules, const NearMaps *maps, size_t number,
                              ptrdiff_t row, ptrdiff_t first, ptrdiff_t last, Line *line) {
    const ptrdiff_t own = maps->top + row, left = maps->left + first - 1, right = maps->left + last + 1;
    const ptrdiff_t begin = left > 0 ? left : 0;
    const ptrdiff_t end = right < (ptrdiff_t)surface->stride ? right + 1 : (ptrdiff_t)surface->stride;
    const size_t count = (size_t)(last - first) + 3;
    uint8_t value[LINE] = {0};
    for (size_t k = 0; k < count; k++)
        line->height[(size_t)first + k] = ABYSS;
    if (own >= 0 && own < (ptrdiff_t)surface->nx + 2 && begin < end) {
        const size_t from = (size_t)begin, length = (size_t)(end - begin);
        memcpy(line->height + first + (begin - left),
               surface_height(surface, number) + (size_t)own * surface->stride + from, length * sizeof(double));
        copy_values(surface, number, (size_t)own, from, length, value + (begin - left));
    }
    for (int place = SIDE; place <= CORNER; place++) {
        load_values(rules->widths[place], surface->problem->kinds, value, count, line->width[place] + first);
        if (rules->is_mixed)
            load_values(rules->slopes[place], surface->problem->kinds, value, count, line->slope[place] + first);
    }
}

/* Reads the pairs of one direction between the cells of a line and those of the next, or of the same, `ahead` lanes
 * further. */
static INLINED void read_pairs(const NearRules *rules, const Line *here, const Line *there, size_t pair, size_t lanes,
                               size_t first, size_t count, size_t cell, const NearStep *step) {
    const float most = rules->most;
    const double *height = here->height + first + 1, *next = there->height + first + lanes;
    const float *width = here->width[pair / 2] + first + 1, *width_next = there->width[pair / 2] + first + lanes;
    float *restrict low = step->low[pair] + cell, *restrict high = step->high[pair] + cell;
    for (size_t k = 0; k < count; k++) {
        const float fall = (float)(next[k] - height[k]);
        low[k] = within(-most, fall - width[k], most);
        high[k] = within(-most, fall + width_next[k], most);
    }
    float *restrict kink = step->kink[pair] ? step->kink[pair] + cell : NULL;
    for (size_t k = 0; kink && k < count; k++)
        kink[k] = within(-most, (float)(next[k] - height[k]), most);
    if (!rules->is_mixed)
        return;
    memcpy(step->give[pair] + cell, here->slope[pair / 2] + first + 1, count * sizeof(float));
    memcpy(step->take[pair] + cell, there->slope[pair / 2] + first + lanes, count * sizeof(float));
}

static INLINED void read_losses(const NearRules *rules, const NearMaps *maps, const NearStep *step, bool is_mixed,
                                bool is_last, size_t cell, size_t count) {
    static const float LEVEL[2 * NEAR_LANES + 3];
    const float *level = LEVEL + NEAR_LANES + 1;
    float *restrict lost = step->lost, *restrict given = step->given;
    for (size_t k = cell; k < cell + count; k++) {
        float gives;
        lost[k] =
            near_loss(step, rules->slope, is_mixed, is_last, (ptrdiff_t)k, (ptrdiff_t)maps->stride, level, &gives);
        if (is_last)
            given[k] = gives;
    }
}

/* Reads a step in the order of the pairs: SIDE ones first. */
static INLINED void read_step(const PlanSurface *surface, const NearRules *rules, const NearMaps *maps, size_t number,
                              const Box *box, ptrdiff_t pairs_top) {
    static const size_t LANES_AHEAD[NEAR_PAIRS] = {2, 1, 2, 0};
    const NearStep *step = &maps->step[number];
    const size_t first = (size_t)box->left, count = (size_t)(box->right - box->left) + 1;
    const bool is_last = number + 1 == surface->steps;
    Line line[2];
    load_line(surface, rules, maps, number, pairs_top, box->left, box->right, &line[0]);
    for (ptrdiff_t row = pairs_top; row <= box->bottom; row++) {
        const size_t cell = (size_t)row * maps->stride + first;
        const Line *here = &line[(row - pairs_top) % 2], *below = &line[(row + 1 - pairs_top) % 2];
        load_line(surface, rules, maps, number, row + 1, box->left, box->right, &line[(row + 1 - pairs_top) % 2]);
        for (size_t pair = 0; pair < NEAR_PAIRS; pair++)
            read_pairs(rules, here, pair ? below : here, pair, LANES_AHEAD[pair], first, count, cell, step);
    }
    for (ptrdiff_t row = box->top; row <= box->bottom; row++) {
        const size_t cell = (size_t)row * maps->stride + first;
        if (rules->is_mixed)
            read_losses(rules, maps, step, true, is_last, cell, count);
        else if (is_last)
            read_losses(rules, maps, step, false, true, cell, count);
        else
            read_losses(rules, maps, step, false, false, cell, count);
    }
}

static void read_plain(const PlanSurface *surface, const NearRules *rules, const NearMaps *maps, const Box *box,
                       ptrdiff_t pairs_top) {
    for (size_t number = 1; number < surface->steps; number++)
        read_step(surface, rules, maps, number, box, pairs_top);
}

static WITH_AVX2 void read_avx2(const PlanSurface *surface, const NearRules *rules, const NearMaps *maps,
                                const Box *box, ptrdiff_t pairs_top) {
    for (size_t number = 1; number < surface->steps; number++)
        read_step(surface, rules, maps, number, box, pairs_top);
}

void near_read(const PlanSurface *surface, const NearRules *rules, const NearMaps *maps, const Box *box,
               ptrdiff_t pairs_top) {
    (HAS_AVX2 ? read_avx2 : read_plain)(surface, rules, maps, box, pairs_top);
}
