/* The plans that a repair can begin from, made and evaluated: nothing and a sound plan first, then what time allows.
 *
 * Each stage is begun only if as much time is left as its like took before, and an ending besides; it is cut off where
 * it takes longer. */
#ifndef INKLOOP_FIRST_PLANS_H
#define INKLOOP_FIRST_PLANS_H

#include <stdbool.h>

#include "plan_surface.h"
#include "plan_work.h"

typedef struct {
    const HorizonProblem *problem;
    const PlanWork *work;
    size_t places;        /* values of a plan */
    double ends_at;       /* by the stopwatch [s]; infinite: no limit */
    double first_ends_at; /* the same for the first plan: infinite where there must be one */
    double evaluation;    /* of a plan, the longest yet [s] */
    bool is_there[STARTS];
    int32_t *plan[STARTS];
    Objective value[STARTS];
    double *droplets;    /* of any size, in `places` */
    int32_t *trial;      /* holds a plan */
    PlanSurface surface; /* of a plan that was evaluated, for others; open once the first plans were made */
    int32_t left_out;    /* LEFT_... */
    double seconds[PHASES];
} FirstPlans;

/* Fills is_there, plan and value; `nothing` is always there, and another one too. CORE_DONE, CORE_NO_MEMORY, or
 * CORE_TIME where `first_ends_at` came before. */
int32_t make_first_plans(FirstPlans *first);

void close_first_plans(FirstPlans *first);

/* When the ending is to begin, by the stopwatch [s], and the time until then. */
double ending_at(const FirstPlans *first);
double seconds_left(const FirstPlans *first);

/* The plans there by their objectives, the lowest first; equal ones stay as they are. Their number. */
int rank_first_plans(const FirstPlans *first, int rank[STARTS]);

#endif
