/* The decision problem of the layers that follow a scan, in the form that the search takes. */
#ifndef INKLOOP_LAYER_PROBLEM_H
#define INKLOOP_LAYER_PROBLEM_H

#include "surface_estimate.h"
#include "horizon_problem.h"
#include "ink_regions.h"

/* The goal of a print, and the work that a layer may take. */
typedef struct {
    size_t nx, ny, horizon;
    size_t foreign_horizon;   /* where the plant is not the model's, `horizon` at most */
    const double *target;     /* for the whole print [m] */
    const uint8_t *part;      /* cells whose heights count; at least one */
    const uint8_t *jettable;  /* cells of the part that droplets may fall on */
    size_t inks;              /* 1 or 2 */
    InkRegions regions;       /* of the first ink */
    int32_t drop_levels;      /* largest number of whole drops of a droplet; inks times as many are at most KINDS_MAX */
    int32_t passes;           /* 1 or 4 */
    double alpha;             /* weight of the mean error against the standard deviation, 0 to 1 */
    double overshoot;         /* what a metre above the target costs when a metre below costs 1; 0: the more, the less
                                 sure the droplets are */
    double overshoot_limit;   /* height above the target that is not to be exceeded [m]; infinite: none */
    double chance_margin;     /* ... kept with so many standard deviations of the predicted height */
    double fringe_weight;     /* weight of the ring of cells around the part */
    double droplet_std;       /* of a droplet's volume, in what plans cost (horizon_problem.h); below 0: as learnt */
    double layer_worth;       /* what a layer must gain (shortest_plan.h) */
    int64_t sweeps;           /* of the repair of one start */
    int64_t annealing_sweeps; /* of one more start that is annealed first; below 0: by the size of the problem */
    int64_t iterations;       /* of the relaxation */
    uint32_t seed;            /* of the annealing */
    double seconds_max;       /* guard by the clock; infinite: none */
} PlannerOptions;

/* What a problem points to: maps of nx * ny, and choices of horizon * nx * ny. */
typedef struct {
    double *ceiling, *weight;
    uint16_t *choices;
} ProblemMaps;

/* The problem of the layers that follow layer number `layer`, whose surface is `estimate`, with its `figures`; it
 * points into that, into the options and into the maps, which it fills. colours: for 4 passes, of each layer of the
 * horizon in the order jetted. */
HorizonProblem layer_problem(const PlannerOptions *options, int32_t colours[HORIZON_MAX][4],
                             const SurfaceEstimate *estimate, const EstimateFigures *figures, int32_t layer,
                             const ProblemMaps *maps);

#endif
