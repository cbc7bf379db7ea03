/* How differences of height spread among the cells near one cell, in single precision.
 *
 * What flows between two cells depends on the rise from one to the other, and ends where a droplet gives no more: so
 * each pair of neighbours has a range in which a difference of their heights makes a difference. The ranges are found
 * once; then any change of the plan is carried through the steps without a look at plan and surfaces.
 *
 * What leaves the near cells is lost from sight, but not from the account: in sum a difference of height never grows,
 * wherever it goes, as long as the slopes of a droplet's flow add up to 1 at most. */
#ifndef INKLOOP_NEAR_FLOW_H
#define INKLOOP_NEAR_FLOW_H

#include "instruction_sets.h"
#include "plan_surface.h"

/* NEAR_REACH cells each way from the one in the middle, row by row, with a lane behind each row that is no cell. Maps
 * have a margin before and behind. */
enum { NEAR_REACH = 3, NEAR_ROWS = 2 * NEAR_REACH + 1, NEAR_LANES = 8, NEAR_CELLS = NEAR_ROWS * NEAR_LANES };
enum { NEAR_MARGIN = 16, NEAR_MAP = NEAR_CELLS + 2 * NEAR_MARGIN, NEAR_PAIRS = 4 };

/* Pairs of a cell with the next one in its row, and with the three below, by the first cell: the difference of their
 * heights counts from `low` to `high` [m]. Up to `kink` the droplet of the first gives more, from there on that of the
 * second less, by `give` and `take` per metre (if kinds differ in that). */
typedef struct {
    float low[NEAR_PAIRS][NEAR_MAP], kink[NEAR_PAIRS][NEAR_MAP], high[NEAR_PAIRS][NEAR_MAP];
    float give[NEAR_PAIRS][NEAR_MAP], take[NEAR_PAIRS][NEAR_MAP];
    float lost[NEAR_MAP], given[NEAR_MAP]; /* as near_loss has them without differences [m] */
} NearStep;

/* Values that hold for all steps. */
typedef struct {
    bool is_mixed;                                            /* kinds differ in their slopes */
    float slope[2];                                           /* of all kinds, or the steepest [1] */
    float none;                                               /* 0 */
    float most;                                               /* no difference of two cells is larger [m] */
    float leaving[NEAR_CELLS];                                /* share of a difference that leaves in a step, at most */
    float within[NEAR_PAIRS][NEAR_CELLS];                     /* 1 where both cells of a pair are near, 0 elsewhere */
    float widths[2][1 + KINDS_MAX], slopes[2][1 + KINDS_MAX]; /* of each value of a plan [m], [1] */
} NearRules;

/* False if differences may grow in sum. */
bool near_rules(const PlanSurface *surface, NearRules *rules);

/* Copies what `map` has around cell (i, j) of the grid; `beyond` where it has no cells. */
void near_copy(const PlanSurface *surface, const double *map, size_t i, size_t j, double beyond, double *cells);

/* Reads a step around cell (i, j) of the grid. */
void near_read(const PlanSurface *surface, const NearRules *rules, size_t i, size_t j, size_t number, NearStep *step);

static INLINED float smaller_of(float a, float b) {
    return a < b ? a : b;
}

static INLINED float larger_of(float a, float b) {
    return a > b ? a : b;
}

static INLINED float within(float low, float value, float high) {
    return larger_of(low, smaller_of(value, high));
}

/* What cell k loses by the pairs of one direction, `ahead` from the first cell to the second; slope: of all kinds. Adds
 * to `given` what of that its own droplet gives. */
static INLINED float pair_loss(const NearStep *step, size_t pair, size_t ahead, bool is_mixed, bool has_given,
                               float slope, const float *before, size_t k, float *given) {
    const size_t last = k - ahead;
    const float to = within(step->low[pair][k], before[k] - before[k + ahead], step->high[pair][k]);
    const float from = within(step->low[pair][last], before[last] - before[k], step->high[pair][last]);
    if (!is_mixed && !has_given)
        return slope * (to - from);
    const float gives = smaller_of(to, step->kink[pair][k]), keeps = larger_of(from, step->kink[pair][last]);
    if (!is_mixed) {
        *given += slope * (gives - keeps);
        return slope * (to - from);
    }
    const float takes = larger_of(to, step->kink[pair][k]), gets = smaller_of(from, step->kink[pair][last]);
    const float own = step->give[pair][k] * gives - step->take[pair][last] * keeps;
    *given += own;
    return own + step->take[pair][k] * takes - step->give[pair][last] * gets;
}

/* What cell k of a map loses in the step by differences of height; `given`: what of that its own droplet gives [m].
 * Both but for a constant. */
static INLINED float near_loss(const NearStep *step, const float slope[2], bool is_mixed, bool has_given,
                               const float *before, size_t k, float *given) {
    *given = 0.0f;
    return pair_loss(step, 0, 1, is_mixed, has_given, slope[SIDE], before, k, given) +
           pair_loss(step, 1, NEAR_LANES, is_mixed, has_given, slope[SIDE], before, k, given) +
           pair_loss(step, 2, NEAR_LANES + 1, is_mixed, has_given, slope[CORNER], before, k, given) +
           pair_loss(step, 3, NEAR_LANES - 1, is_mixed, has_given, slope[CORNER], before, k, given);
}

#endif
