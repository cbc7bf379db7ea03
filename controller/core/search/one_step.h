/* Trial and execution of changes of a plan that is printed in one step: all at once, without a window.
 *
 * The surface under the droplets stays, so a change moves heights within one cell of it and nowhere else. */
#ifndef INKLOOP_ONE_STEP_H
#define INKLOOP_ONE_STEP_H

#include "plan_surface.h"

/* As plan_trial, for a surface of one step; cost_alone: the other sums stay 0. */
Sums one_step_trial(const PlanSurface *surface, const Change *change, size_t count, bool cost_alone);

/* As plan_apply without the plan: the surface alone. */
void one_step_apply(PlanSurface *surface, const Change *change, size_t count);

#endif
