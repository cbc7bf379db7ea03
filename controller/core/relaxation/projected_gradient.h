/* Descent of the relaxed objective by accelerated projected gradients (Nesterov 1983; restarts: O'Donoghue, Candes
 * 2015), while its smoothing shrinks. */
#ifndef INKLOOP_PROJECTED_GRADIENT_H
#define INKLOOP_PROJECTED_GRADIENT_H

#include "relaxed_surface.h"

/* Moves `droplets` from where they are, each within 0 and the largest drop allowed there, for `iterations_max` steps
 * (CORE_DONE) or `seconds_max` (CORE_TIME); what it leaves is not worse than the start. Or CORE_NO_MEMORY. Where the
 * time was too short for the value of the start, the value is infinite. */
int32_t projected_gradient(RelaxedSurface *surface, const RelaxationOptions *options, double *droplets,
                           RelaxationReport *report);

#endif
