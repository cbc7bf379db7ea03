/* The layer problem of the model predictive controller for one horizon, solved: relaxed, rounded, repaired, compared.
 *
 * The relaxed problem is solved and rounded by ordered error diffusion; that start, the rest of the last plan, full
 * layers and none are repaired by flips, swaps and shifts: the best of them, or where annealing is worth its time all
 * of them and once more the best one, annealed. The best result is taken. It is compared with printing nothing:
 * otherwise a small alpha would trade height for evenness forever.
 *
 * A time limit leaves out stages; nothing, and the missing height rounded in equal shares, are always compared. */
#ifndef INKLOOP_HORIZON_PLANNER_H
#define INKLOOP_HORIZON_PLANNER_H

#include "horizon_problem.h"

/* In the order of PlanStatus in layer_plan.py. */
enum { PLAN_REPAIRED = 1, PLAN_BUDGET = 2, PLAN_TIME_LIMIT = 3, PLAN_STOPPED = 4, PLAN_FALLBACK = 5, PLAN_DONE = 7 };

/* Plans to begin from, in the order in which equal ones win. */
enum { START_NOTHING, START_FULL_LAYERS, START_LAST_PLAN, START_RELAXATION, STARTS };

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
    int64_t sweeps;           /* of the repair of one start */
    int64_t annealing_sweeps; /* of one more start that is annealed first; below 0: by the size of the problem */
    int64_t iterations;       /* of the relaxation */
    uint64_t seed;            /* of the annealing */
    double seconds_max;       /* guard by the clock; infinite: none */
    int32_t threads;          /* 1 or more; the bits of the answer do not depend on it */
    int32_t (*after_sweep)(void *caller, const SearchReport *so_far); /* not 0: stop the repairs; NULL: none */
    void *caller;
} PlanWork;

typedef struct {
    int32_t status; /* PLAN_... */
    int32_t start;  /* START_...: what the plan was made from */
    int32_t is_annealed;
    int32_t left_out;             /* LEFT_... */
    int64_t sweeps;               /* of all repairs together */
    Objective objective, nothing; /* of the plan; of printing nothing */
    double evaluation;            /* what that of a plan took [s] */
    double seconds[PHASES];
} PlanReport;

/* The best plan found (layers * nx * ny); PLAN_DONE if that is to print nothing. CORE_DONE or CORE_NO_MEMORY. */
int32_t plan_horizon(const HorizonProblem *problem, const PlanWork *work, int32_t *plan, PlanReport *report);

#endif
