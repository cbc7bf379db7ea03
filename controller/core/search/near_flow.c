#include "near_flow.h"

#include <math.h>
#include <string.h>

static const double ABYSS = -1.0; /* of cells that are not on the grid, as deep as the frame [m] */

static const double SAME_SLOPE = 1e-7; /* slopes that differ by less, as a share, count as one (assumed) */

/* 1 where a pair is of two near cells. */
static void mark_pairs(float marks[NEAR_PAIRS][NEAR_CELLS]) {
    for (size_t k = 0; k < NEAR_CELLS; k++) {
        const size_t lane = k % NEAR_LANES;
        const bool is_above = k / NEAR_LANES + 1 < NEAR_ROWS;
        marks[0][k] = lane + 1 < NEAR_ROWS ? 1.0f : 0.0f;
        marks[1][k] = is_above && lane < NEAR_ROWS ? 1.0f : 0.0f;
        marks[2][k] = is_above && lane + 1 < NEAR_ROWS ? 1.0f : 0.0f;
        marks[3][k] = is_above && lane > 0 && lane < NEAR_ROWS ? 1.0f : 0.0f;
    }
}

bool near_rules(const PlanSurface *surface, NearRules *rules) {
    double steepest[2] = {0.0, 0.0}, largest = 0.0;
    *rules = (NearRules){.is_mixed = false};
    mark_pairs(rules->within);
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
    rules->most = (float)(4.0 * largest); /* two droplets come and two go */
    for (size_t row = 0; row < NEAR_ROWS; row++)
        for (size_t lane = 0; lane < NEAR_ROWS; lane++) {
            const bool ends_row = row == 0 || row + 1 == NEAR_ROWS, ends_lane = lane == 0 || lane + 1 == NEAR_ROWS;
            const double corners = ends_row && ends_lane ? 3.0 : ends_row || ends_lane ? 2.0 : 0.0;
            const double leaving = (ends_row + ends_lane) * steepest[SIDE] + corners * steepest[CORNER];
            rules->leaving[row * NEAR_LANES + lane] = (float)leaving;
        }
    return 4.0 * (steepest[SIDE] + steepest[CORNER]) < 1.0;
}

/* Where the row of near cells begins in a map, and whether all of its lanes are in there. */
static bool is_row_in_map(const PlanSurface *surface, size_t i, size_t j, size_t row, ptrdiff_t *first) {
    const ptrdiff_t framed = (ptrdiff_t)(i + 1 + row) - NEAR_REACH, left = (ptrdiff_t)(j + 1) - NEAR_REACH;
    *first = framed * (ptrdiff_t)surface->stride + left;
    return framed >= 0 && framed < (ptrdiff_t)surface->nx + 2 && left >= 0 &&
           left + NEAR_LANES <= (ptrdiff_t)surface->stride;
}

static bool is_in_map(const PlanSurface *surface, size_t i, size_t j, size_t row, size_t lane) {
    const ptrdiff_t framed = (ptrdiff_t)(i + 1 + row) - NEAR_REACH;
    const ptrdiff_t column = (ptrdiff_t)(j + 1 + lane) - NEAR_REACH;
    return framed >= 0 && framed < (ptrdiff_t)surface->nx + 2 && column >= 0 && column < (ptrdiff_t)surface->stride;
}

void near_copy(const PlanSurface *surface, const double *map, size_t i, size_t j, double beyond, double *cells) {
    for (size_t row = 0; row < NEAR_ROWS; row++, cells += NEAR_LANES) {
        ptrdiff_t first;
        if (is_row_in_map(surface, i, j, row, &first)) {
            memcpy(cells, map + first, NEAR_LANES * sizeof(double));
            continue;
        }
        for (size_t lane = 0; lane < NEAR_LANES; lane++)
            cells[lane] = is_in_map(surface, i, j, row, lane) ? map[first + (ptrdiff_t)lane] : beyond;
    }
}

/* The values that are jetted in the step. */
static void copy_values(const PlanSurface *surface, size_t i, size_t j, size_t number, uint8_t *cells) {
    const size_t passes = (size_t)surface->problem->passes, layer = number / passes;
    const int32_t colour = passes == 1 ? COLOUR_ALL : surface->problem->colours[layer][number % passes];
    const uint8_t *values = surface_layer(surface, layer);
    for (size_t row = 0; row < NEAR_ROWS; row++, cells += NEAR_LANES) {
        ptrdiff_t first;
        const bool is_whole = is_row_in_map(surface, i, j, row, &first);
        if (is_whole)
            memcpy(cells, values + first, NEAR_LANES);
        for (size_t lane = 0; !is_whole && lane < NEAR_LANES; lane++)
            cells[lane] = is_in_map(surface, i, j, row, lane) ? values[first + (ptrdiff_t)lane] : 0;
        for (size_t lane = 0; colour != COLOUR_ALL && lane < NEAR_LANES; lane++)
            if (cells[lane] && colour != cell_colour(i + row - NEAR_REACH, j + lane - NEAR_REACH))
                cells[lane] = 0;
    }
}

static INLINED void load_values(const float *of, size_t kinds, const uint8_t *restrict value, float *restrict cells) {
    for (size_t k = 0; k < NEAR_CELLS; k++)
        cells[k] = 0.0f;
    for (uint8_t kind = 1; kind <= kinds; kind++) {
        const float own = of[kind];
        for (size_t k = 0; k < NEAR_CELLS; k++)
            cells[k] = value[k] == kind ? own : cells[k];
    }
}

static INLINED void read_pairs(const NearRules *rules, size_t pair, const float *restrict marks,
                               const double *restrict before, const float *restrict width, NearStep *restrict step) {
    static const size_t AHEAD[NEAR_PAIRS] = {1, NEAR_LANES, NEAR_LANES + 1, NEAR_LANES - 1};
    const float most = rules->most;
    const double *next = before + AHEAD[pair];
    const float *width_next = width + AHEAD[pair];
    float *low = step->low[pair] + NEAR_MARGIN, *kink = step->kink[pair] + NEAR_MARGIN;
    float *high = step->high[pair] + NEAR_MARGIN;
    for (size_t k = 0; k < NEAR_CELLS; k++) {
        const float fall = (float)(next[k] - before[k]);
        low[k] = marks[k] * within(-most, fall - width[k], most);
        kink[k] = marks[k] * within(-most, fall, most);
        high[k] = marks[k] * within(-most, fall + width_next[k], most);
    }
}

static INLINED void read_slopes(size_t pair, const float *restrict marks, const float *restrict slope,
                                NearStep *restrict step) {
    static const size_t AHEAD[NEAR_PAIRS] = {1, NEAR_LANES, NEAR_LANES + 1, NEAR_LANES - 1};
    for (size_t k = 0; k < NEAR_CELLS; k++) {
        step->give[pair][NEAR_MARGIN + k] = marks[k] * slope[k];
        step->take[pair][NEAR_MARGIN + k] = marks[k] * slope[k + AHEAD[pair]];
    }
}

static INLINED void read_losses(const NearRules *rules, bool is_mixed, NearStep *restrict step) {
    static const float LEVEL[NEAR_MAP];
    for (size_t k = NEAR_MARGIN; k < NEAR_MARGIN + NEAR_CELLS; k++)
        step->lost[k] = near_loss(step, rules->slope, is_mixed, true, LEVEL, k, &step->given[k]);
}

static INLINED void read_step(const NearRules *rules, size_t kinds, const double *before, const uint8_t *value,
                              NearStep *step) {
    float cells[NEAR_MAP];
    memset(cells + NEAR_CELLS, 0, (NEAR_MAP - NEAR_CELLS) * sizeof(float));
    for (size_t pair = 0; pair < NEAR_PAIRS; pair++) {
        if (pair % 2 == 0)
            load_values(rules->widths[pair / 2], kinds, value, cells);
        read_pairs(rules, pair, rules->within[pair], before, cells, step);
    }
    for (size_t pair = 0; rules->is_mixed && pair < NEAR_PAIRS; pair++) {
        load_values(rules->slopes[pair / 2], kinds, value, cells);
        read_slopes(pair, rules->within[pair], cells, step);
    }
    if (rules->is_mixed)
        read_losses(rules, true, step);
    else
        read_losses(rules, false, step);
}

static void read_step_plain(const NearRules *rules, size_t kinds, const double *before, const uint8_t *value,
                            NearStep *step) {
    read_step(rules, kinds, before, value, step);
}

static WITH_AVX2 void read_step_avx2(const NearRules *rules, size_t kinds, const double *before, const uint8_t *value,
                                     NearStep *step) {
    read_step(rules, kinds, before, value, step);
}

void near_read(const PlanSurface *surface, const NearRules *rules, size_t i, size_t j, size_t number, NearStep *step) {
    double before[NEAR_MAP];
    uint8_t value[NEAR_CELLS];
    near_copy(surface, surface_height(surface, number), i, j, ABYSS, before);
    memset(before + NEAR_CELLS, 0, (NEAR_MAP - NEAR_CELLS) * sizeof(double));
    copy_values(surface, i, j, number, value);
    (HAS_AVX2 ? read_step_avx2 : read_step_plain)(rules, surface->problem->kinds, before, value, step);
}
