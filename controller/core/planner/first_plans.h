/* Start plans of the repair, made and evaluated: nothing and a sound plan first, then others as time allows.
 *
 * A stage begins only if the time left covers its expected duration and the ending; it is cut off if it takes
 * longer. */
#ifndef INKLOOP_FIRST_PLANS_H
#define INKLOOP_FIRST_PLANS_H

#include <stdbool.h>

#include "plan_surface.h"
#include "plan_work.h"

typedef struct {
    const HorizonProblem *problem;
    const PlanWork *work;
    size_t places;        /* number of values of a plan */
    double ends_at;       /* by the stopwatch [s]; infinite: no limit */
    double first_ends_at; /* the same for the first plan: infinite if one is required */
    double evaluation;    /* longest evaluation of a plan so far [s] */
    bool is_there[STARTS];
    int32_t *plan[STARTS];
    Objective value[STARTS];
    double *droplets;    /* droplets of any size, `places` values */
    int32_t *trial;      /* memory for a plan */
    PlanSurface surface; /* surface of an evaluated plan, for others to use; open once the first plans were made */
    int32_t left_out;    /* LEFT_... */
    double seconds[PHASES];
} FirstPlans;

/* Fills is_there, plan and value; `nothing` is always there, and another one too. CORE_DONE, CORE_NO_MEMORY, or
 * CORE_TIME where `first_ends_at` came before. */
int32_t make_first_plans(FirstPlans *first);

void close_first_plans(FirstPlans *first);

/* Time at which the ending begins, by the stopwatch [s], and the time until then. */
double ending_at(const FirstPlans *first);
double seconds_left(const FirstPlans *first);

/* Ranks the plans by their objectives, the lowest first; equal ones keep their order. Returns their number. */
int rank_first_plans(const FirstPlans *first, int rank[STARTS]);

#endif
