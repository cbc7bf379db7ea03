/* Plans to begin a search from, and what is left of a plan as the horizon recedes. A plan is layers * nx * ny values.
 */
#ifndef INKLOOP_PLAN_STARTS_H
#define INKLOOP_PLAN_STARTS_H

#include <stdbool.h>

#include "horizon_problem.h"

/* Wherever a droplet may fall, one of the first kind that may. */
void full_layers(const HorizonProblem *problem, int32_t *plan);

/* The missing height of each cell in equal shares of the layers: droplets of any size, 0 to 1. */
void even_droplets(const HorizonProblem *problem, double *droplets);

/* The rest of the last plan, its last layer once more, without what may not fall any longer. */
void shift_plan(const HorizonProblem *problem, const int32_t *last, size_t last_layers, int32_t *plan);

/* The rest of the last plan after empty layers, without what may not fall any longer; it has layers + 1 at most. */
void postpone_plan(const HorizonProblem *problem, const int32_t *last, size_t last_layers, int32_t *plan);

/* A plan for one layer more without its first layer, whose droplets fall in the first later layer that has none on
 * their cell. What may not fall in its new place becomes the kind that may. */
void squeeze_plan(const HorizonProblem *problem, const int32_t *longer, int32_t *plan);

/* Moves the empty first layers to the end; what may not fall so early becomes the kind that may. `moved` holds a plan.
 * True if a layer was moved. */
bool leave_idle_start(const HorizonProblem *problem, int32_t *plan, int32_t *moved);

#endif
