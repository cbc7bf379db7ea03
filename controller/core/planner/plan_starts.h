/* Start plans of a search, and the rest of a plan as the horizon recedes. A plan is layers * nx * ny values, made by
 * threads. */
#ifndef INKLOOP_PLAN_STARTS_H
#define INKLOOP_PLAN_STARTS_H

#include <stdbool.h>

#include "horizon_problem.h"

/* A droplet of the first kind allowed wherever one is allowed. */
void full_layers(const HorizonProblem *problem, int32_t threads, int32_t *plan);

/* The missing height of each cell in equal shares over the layers: droplets of any size, 0 to 1. */
void even_droplets(const HorizonProblem *problem, int32_t threads, double *droplets);

/* The last plan shifted by one layer, its last layer repeated, without droplets that are no longer allowed. */
void shift_plan(const HorizonProblem *problem, int32_t threads, const int32_t *last, size_t last_layers, int32_t *plan);

/* The rest of the last plan after empty layers, without droplets that are no longer allowed; it has layers + 1 at
 * most. */
void postpone_plan(const HorizonProblem *problem, int32_t threads, const int32_t *last, size_t last_layers,
                   int32_t *plan);

/* A plan for one layer more without its first layer, whose droplets move to the first later layer without a droplet on
 * their cell. A droplet that is not allowed in its new place becomes the kind that is. */
void squeeze_plan(const HorizonProblem *problem, int32_t threads, const int32_t *longer, int32_t *plan);

/* Moves the empty first layers to the end; a droplet that is not allowed in its new layer becomes the kind that is.
 * `moved` holds a plan. True if a layer was moved. */
bool leave_idle_start(const HorizonProblem *problem, int32_t *plan, int32_t *moved);

#endif
