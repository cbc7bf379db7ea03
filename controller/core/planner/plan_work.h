/* What a plan may begin from, the work that it may take, and what a time limit may leave out of it. */
#ifndef INKLOOP_PLAN_WORK_H
#define INKLOOP_PLAN_WORK_H

#include "horizon_problem.h"

/* Plans to begin from, in the order in which equal ones win. With a longer plan its rest is in the place of the last
 * plan's, and is reported by a number of its own. */
enum { START_NOTHING, START_FULL_LAYERS, START_LAST_PLAN, START_RELAXATION, STARTS, START_LONGER_PLAN = STARTS };

/* What a time limit has left out or cut short, as a sum. In the order of LeftOut in layer_plan.py. */
enum { LEFT_RELAXATION = 1, LEFT_STARTS = 2, LEFT_REPAIR = 4, LEFT_FEWER_LAYERS = 8 };

enum { RELAX_HERE, RELAX_GIVEN, RELAX_NOTHING };
enum { PHASE_RELAXATION, PHASE_ROUNDING, PHASE_REPAIR, PHASES };

/* The work that a plan may take, and what there is to begin from. */
typedef struct {
    int32_t relaxation;       /* RELAX_...: by projected gradients, in `relaxed`, or no such start */
    const double *relaxed;    /* droplets of any size, layers * nx * ny */
    const int32_t *last;      /* the last plan, last_layers * nx * ny; NULL: none */
    size_t last_layers;       /* 1 or more */
    double layer_worth;       /* see shortest_plan.h; of no meaning for a single horizon */
    const int32_t *longer;    /* a plan for one layer more, of which nothing is printed; NULL: none. With it none other
                                 is needed: without the time for a first one there is none */
    double longer_value;      /* its objective [m] */
    double layer_price;       /* that of a plan for its layers but one may be higher by so much, to be of use [m] */
    int64_t sweeps;           /* of the repair of one start */
    int64_t annealing_sweeps; /* of one more start that is annealed first; below 0: by the size of the problem */
    int64_t iterations;       /* of the relaxation */
    uint64_t seed;            /* of the annealing */
    double seconds_max;       /* guard by the clock; infinite: none */
    int32_t threads;          /* 1 or more; the bits of the answer do not depend on it */
    AfterSweep *after_sweep;  /* of the repairs; NULL: none */
    void *caller;
} PlanWork;

#endif
