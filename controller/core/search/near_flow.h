/* Propagation of height differences among the cells near one cell, in single precision.
 *
 * The flow between two cells depends on the rise from one to the other, and saturates: so each pair of neighbours has a
 * range in which the flow depends on their heights. The ranges are computed once for all cells of a tile, and again
 * where the plan changes; with them any change of the plan is propagated through the steps without reading plan and
 * surfaces.
 *
 * Differences that leave the near cells are out of sight but still bounded: their sum never grows, as long as the
 * slopes of a droplet's flow add up to 1 at most. */
#ifndef INKLOOP_NEAR_FLOW_H
#define INKLOOP_NEAR_FLOW_H

#include "box.h"
#include "instruction_sets.h"
#include "plan_surface.h"
#include "tile.h"

/* The near cells: NEAR_REACH each way from the one in the middle, row by row, with a lane behind each row that is no
 * cell. Copies of them have a margin before and behind. */
enum { NEAR_REACH = 3, NEAR_ROWS = 2 * NEAR_REACH + 1, NEAR_LANES = 8, NEAR_CELLS = NEAR_ROWS * NEAR_LANES };
enum { NEAR_MARGIN = 16, NEAR_MAP = NEAR_CELLS + 2 * NEAR_MARGIN, NEAR_PAIRS = 4 };

/* Maps of a step. A pair is a cell with the next one in its row, or with one of the three below; it is stored at the
 * first cell. The flow depends on the difference of their heights from `low` to `high` [m]: up to `kink` the first
 * droplet gives more, beyond it the second gives less. `give` and `take` are the slopes, for mixed kinds; `kink` is
 * stored for the last step or mixed kinds. */
typedef struct {
    float *low[NEAR_PAIRS], *kink[NEAR_PAIRS], *high[NEAR_PAIRS];
    float *give[NEAR_PAIRS], *take[NEAR_PAIRS];
    float *lost, *given; /* results of near_loss for differences of 0 [m]; `given` in the last step */
} NearStep;

/* Values that hold for all steps. */
typedef struct {
    bool is_mixed;  /* kinds differ in their slopes */
    float slope[2]; /* slopes of all kinds, or the steepest [1] */
    float none;     /* 0 */
    float most;     /* largest difference of two cells [m] */
    /* largest share of a difference that leaves the near cells in a step */
    float leaving[NEAR_CELLS];
    float widths[2][1 + KINDS_MAX], slopes[2][1 + KINDS_MAX]; /* widths [m] and slopes [1] for each value of a plan */
} NearRules;

/* Maps of the cells of a tile and of those near them, with the same order of cells. */
typedef struct {
    ptrdiff_t top, left; /* cell of the surface's maps that is the first of these */
    size_t rows, stride; /* size of the largest tile */
    NearStep *step;      /* one for each step; that of the first is empty */
    void *memory;
} NearMaps;

/* False if the sum of the differences may grow. */
bool near_rules(const PlanSurface *surface, NearRules *rules);

/* False if there is no memory. */
bool near_open(const PlanSurface *surface, const NearRules *rules, NearMaps *maps);
void near_close(NearMaps *maps);

/* Begins with a tile, of which nothing has been read. */
static inline void near_begin(NearMaps *maps, const Tile *tile) {
    maps->top = (ptrdiff_t)tile->top - NEAR_REACH;
    maps->left = (ptrdiff_t)tile->left - NEAR_REACH;
}

/* First of the cells near cell (i, j) of the grid, in the maps. */
static inline size_t near_first(const NearMaps *maps, size_t i, size_t j) {
    const ptrdiff_t row = (ptrdiff_t)(i + 1) - NEAR_REACH - maps->top;
    const ptrdiff_t column = (ptrdiff_t)(j + 1) - NEAR_REACH - maps->left;
    return (size_t)row * maps->stride + (size_t)column;
}

/* Reads all steps in a box of the maps' cells; the pairs from row `pairs_top` to bottom. */
void near_read(const PlanSurface *surface, const NearRules *rules, const NearMaps *maps, const Box *box,
               ptrdiff_t pairs_top);

static INLINED float smaller_of(float a, float b) {
    return a < b ? a : b;
}

static INLINED float larger_of(float a, float b) {
    return a > b ? a : b;
}

static INLINED float within(float low, float value, float high) {
    return larger_of(low, smaller_of(value, high));
}

/* Loss of a cell of the maps by the pairs of one direction, `last` being the first cell of the other pair; the
 * difference falls by `fall` and by `fall_last` from the first to the second cell; slope: that of all kinds. Adds the
 * part given by its own droplet to `given`. */
static INLINED float pair_loss(const NearStep *step, size_t pair, ptrdiff_t cell, ptrdiff_t last, bool is_mixed,
                               bool has_given, float slope, float fall, float fall_last, float *given) {
    const float to = within(step->low[pair][cell], fall, step->high[pair][cell]);
    const float from = within(step->low[pair][last], fall_last, step->high[pair][last]);
    if (!is_mixed && !has_given)
        return slope * (to - from);
    const float gives = smaller_of(to, step->kink[pair][cell]), keeps = larger_of(from, step->kink[pair][last]);
    if (!is_mixed) {
        *given += slope * (gives - keeps);
        return slope * (to - from);
    }
    const float takes = larger_of(to, step->kink[pair][cell]), gets = smaller_of(from, step->kink[pair][last]);
    const float own = step->give[pair][cell] * gives - step->take[pair][last] * keeps;
    *given += own;
    return own + step->take[pair][cell] * takes - step->give[pair][last] * gets;
}

/* Loss of a cell of the maps in the step by height differences, those of the near cells from `before` on; rows of the
 * maps are `stride` apart; `given`: the part given by its own droplet [m]. Both up to a constant. */
static INLINED float near_loss(const NearStep *step, const float slope[2], bool is_mixed, bool has_given,
                               ptrdiff_t cell, ptrdiff_t stride, const float *before, float *given) {
    const float own = *before;
    *given = 0.0f;
    return pair_loss(step, 0, cell, cell - 1, is_mixed, has_given, slope[SIDE], own - before[1], before[-1] - own,
                     given) +
           pair_loss(step, 1, cell, cell - stride, is_mixed, has_given, slope[SIDE], own - before[NEAR_LANES],
                     before[-NEAR_LANES] - own, given) +
           pair_loss(step, 2, cell, cell - stride - 1, is_mixed, has_given, slope[CORNER], own - before[NEAR_LANES + 1],
                     before[-NEAR_LANES - 1] - own, given) +
           pair_loss(step, 3, cell, cell - stride + 1, is_mixed, has_given, slope[CORNER], own - before[NEAR_LANES - 1],
                     before[1 - NEAR_LANES] - own, given);
}

#endif
