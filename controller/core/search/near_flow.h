/* How differences of height spread among the cells near one cell, in single precision.
 *
 * What flows between two cells depends on the rise from one to the other, and ends where a droplet gives no more: so
 * each pair of neighbours has a range in which a difference of their heights makes a difference. The ranges are found
 * once for all cells of a tile, and again where the plan is changed; any change of the plan is carried through the
 * steps by them without a look at plan and surfaces.
 *
 * What leaves the near cells is lost from sight, but not from the account: in sum a difference of height never grows,
 * wherever it goes, as long as the slopes of a droplet's flow add up to 1 at most. */
#ifndef INKLOOP_NEAR_FLOW_H
#define INKLOOP_NEAR_FLOW_H

#include "box.h"
#include "instruction_sets.h"
#include "plan_surface.h"
#include "tile.h"

/* NEAR_REACH cells each way from the one in the middle, row by row, with a lane behind each row that is no cell. Copies
 * of them have a margin before and behind. */
enum { NEAR_REACH = 3, NEAR_ROWS = 2 * NEAR_REACH + 1, NEAR_LANES = 8, NEAR_CELLS = NEAR_ROWS * NEAR_LANES };
enum { NEAR_MARGIN = 16, NEAR_MAP = NEAR_CELLS + 2 * NEAR_MARGIN, NEAR_PAIRS = 4 };

/* Maps of a step: pairs of a cell with the next one in its row, and with the three below, by the first cell: the
 * difference of their heights counts from `low` to `high` [m]. Up to `kink` the droplet of the first gives more, from
 * there on that of the second less (in the last step, or if kinds are mixed), by `give` and `take` per metre (if they
 * are). */
typedef struct {
    float *low[NEAR_PAIRS], *kink[NEAR_PAIRS], *high[NEAR_PAIRS];
    float *give[NEAR_PAIRS], *take[NEAR_PAIRS];
    float *lost, *given; /* as near_loss has them without differences [m]; `given` in the last step */
} NearStep;

/* Values that hold for all steps. */
typedef struct {
    bool is_mixed;                                            /* kinds differ in their slopes */
    float slope[2];                                           /* of all kinds, or the steepest [1] */
    float none;                                               /* 0 */
    float most;                                               /* no difference of two cells is larger [m] */
    float leaving[NEAR_CELLS];                                /* share of a difference that leaves in a step, at most */
    float widths[2][1 + KINDS_MAX], slopes[2][1 + KINDS_MAX]; /* of each value of a plan [m], [1] */
} NearRules;

/* Maps of the cells of a tile and of those near them, with the same order of cells. */
typedef struct {
    ptrdiff_t top, left; /* cell of the surface's maps that is their first */
    size_t rows, stride; /* as many as the largest tile needs */
    NearStep *step;      /* one for each step; that of the first is empty */
    void *memory;
} NearMaps;

/* False if differences may grow in sum. */
bool near_rules(const PlanSurface *surface, NearRules *rules);

/* False if there is no memory. */
bool near_open(const PlanSurface *surface, const NearRules *rules, NearMaps *maps);
void near_close(NearMaps *maps);

/* Begins with a tile, of which nothing is read. */
static inline void near_begin(NearMaps *maps, const Tile *tile) {
    maps->top = (ptrdiff_t)tile->top - NEAR_REACH;
    maps->left = (ptrdiff_t)tile->left - NEAR_REACH;
}

/* Where the first of the cells near cell (i, j) of the grid is in the maps. */
static inline size_t near_first(const NearMaps *maps, size_t i, size_t j) {
    const ptrdiff_t row = (ptrdiff_t)(i + 1) - NEAR_REACH - maps->top;
    const ptrdiff_t column = (ptrdiff_t)(j + 1) - NEAR_REACH - maps->left;
    return (size_t)row * maps->stride + (size_t)column;
}

/* Reads all steps in a box of the maps' cells; the pairs of `pairs_top` to bottom. */
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

/* What a cell of the maps loses by the pairs of one direction, `last` being the first cell of the other pair, where the
 * difference falls by `fall` and by `fall_last` from the first to the second cell; slope: of all kinds. Adds to `given`
 * what of that its own droplet gives. */
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

/* What a cell of the maps, whose rows are `stride` apart, loses in the step by differences of height, those of the near
 * cells from `before` on; `given`: what of that its own droplet gives [m]. Both but for a constant. */
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
