/* Inputs and limits of planning: start plans, budgets, and stages that a time limit may skip. */
#ifndef INKLOOP_PLAN_WORK_H
#define INKLOOP_PLAN_WORK_H

#include "horizon_problem.h"

/* Start plans; of equal ones the first wins. The rest of a longer plan takes the place of the last plan's, and is
 * reported by its own number. */
enum { START_NOTHING, START_FULL_LAYERS, START_LAST_PLAN, START_RELAXATION, STARTS, START_LONGER_PLAN = STARTS };

/* Stages that a time limit has skipped or cut short, as a sum. In the order of LeftOut in layer_plan.py. */
enum { LEFT_RELAXATION = 1, LEFT_STARTS = 2, LEFT_REPAIR = 4, LEFT_FEWER_LAYERS = 8 };

enum { RELAX_HERE, RELAX_GIVEN, RELAX_NOTHING };
enum { PHASE_RELAXATION, PHASE_ROUNDING, PHASE_REPAIR, PHASES };

/* Limits of the work on a plan, and its start plans. */
typedef struct {
    int32_t relaxation;    /* RELAX_...: by projected gradients, as given in `relaxed`, or none */
    const double *relaxed; /* droplets of any size, layers * nx * ny */
    const int32_t *last;   /* the last plan, last_layers * nx * ny; NULL: none */
    size_t last_layers;    /* 1 or more */
    double layer_worth;    /* see shortest_plan.h; unused for a single horizon */
    /* A plan for one layer more, of which nothing is printed; NULL: none. It replaces a first plan if there is no time
     * for one. */
    const int32_t *longer;
    double longer_value; /* its objective [m] */
    double layer_price;  /* largest increase of the objective for one layer less [m] */
    int64_t sweeps;      /* sweeps in the repair of one start */
    /* sweeps of one more start that is annealed first; below 0: by the size of the problem */
    int64_t annealing_sweeps;
    int64_t iterations;      /* iterations of the relaxation */
    uint64_t seed;           /* seed of the annealing */
    double seconds_max;      /* time limit; infinite: none */
    int32_t threads;         /* 1 or more; the bits of the answer do not depend on it */
    DeviceSearch *device;    /* repairs plans in place of the search here; NULL: none */
    AfterSweep *after_sweep; /* stops the repairs if not 0; NULL: none */
    void *caller;
} PlanWork;

#endif
