/* Descent of the relaxed objective by accelerated projected gradients (Nesterov 1983; restarts: O'Donoghue, Candes
 * 2015), while its smoothing shrinks. */
#ifndef INKLOOP_PROJECTED_GRADIENT_H
#define INKLOOP_PROJECTED_GRADIENT_H

#include "relaxed_surface.h"

/* Minimises over `droplets`, each between 0 and the largest drop allowed there, for `iterations_max` steps (CORE_DONE)
 * or `seconds_max` (CORE_TIME), or returns CORE_NO_MEMORY. The result is not worse than the start. If the time was too
 * short to evaluate the start, the value is infinite. */
int32_t projected_gradient(RelaxedSurface *surface, const RelaxationOptions *options, double *droplets,
                           RelaxationReport *report);

#endif
