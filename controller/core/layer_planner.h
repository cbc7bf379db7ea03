/* The layer problem of the model predictive controller: relaxed, rounded, repaired, and compared.
 *
 * The relaxed problem is solved and rounded by ordered error diffusion; that start, the rest of the last plan, full
 * layers and none are repaired by flips, swaps and shifts, and the best result is taken. It is compared with printing
 * nothing: without that a small alpha trades height for evenness for ever. Dead cells are left out, but for a layer now
 * and then in which they are tried again. The same answers as LayerMpc in Python with relaxation = "gradient". */
#ifndef INKLOOP_LAYER_PLANNER_H
#define INKLOOP_LAYER_PLANNER_H

#include "height_estimator.h"
#include "horizon_problem.h"
#include "ink_regions.h"

/* What a print is to become, and the work that a layer may take. */
typedef struct {
    size_t nx, ny, horizon;
    const double *target;    /* for the whole print [m] */
    const uint8_t *part;     /* cells whose heights count; at least one */
    const uint8_t *jettable; /* cells of the part that droplets may fall on */
    size_t inks;             /* 1 or 2 */
    InkRegions regions;      /* of the first ink */
    int32_t drop_levels;     /* largest number of whole drops of a droplet; inks times as many are at most KINDS_MAX */
    int32_t passes;          /* 1 or 4 */
    double alpha;            /* weight of the mean error against the standard deviation, 0 to 1 */
    double overshoot;        /* what a metre above the target costs when a metre below costs 1 */
    double overshoot_limit;  /* height above the target that is not to be exceeded [m]; infinite: none */
    double chance_margin;    /* ... kept with so many standard deviations of the predicted height */
    double fringe_weight;    /* weight of the ring of cells beside the part */
    double layer_worth;      /* share of the objective that a layer must gain to come before the fuller ones after it */
    int64_t sweeps;          /* of the repair of one start */
    int64_t annealing_sweeps; /* of one more start that is annealed first; below 0: by the size of the problem */
    int64_t iterations;       /* of the relaxation */
    uint32_t seed;            /* of the annealing */
    double seconds_max;       /* guard by the clock; infinite: none */
} PlannerOptions;

/* In the order of PlanStatus in layer_plan.py. */
enum { PLAN_REPAIRED = 1, PLAN_BUDGET = 2, PLAN_TIME_LIMIT = 3, PLAN_FALLBACK = 5, PLAN_DONE = 7 };

typedef struct {
    int32_t status; /* PLAN_... */
    int64_t sweeps; /* of all repairs together */
    Objective objective;
} PlanReport;

/* The best plan found for the layers that follow layer number `layer`, whose surface is `estimate`; PLAN_DONE if that
 * is to print nothing. colours: for 4 passes, of each layer of the horizon in the order jetted. last: the last plan, or
 * zeros; plan: horizon * nx * ny, 0 nothing, 1 + (drops - 1) * inks + index of the ink. CORE_DONE or CORE_NO_MEMORY. */
int32_t plan_layers(const PlannerOptions *options, int32_t colours[HORIZON_MAX][4], const SurfaceEstimate *estimate,
                    int32_t layer, const int32_t *last, int32_t *plan, PlanReport *report);

#endif
