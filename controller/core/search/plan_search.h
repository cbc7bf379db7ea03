/* Search for a better plan: annealing if requested, then descent by flips, swaps and shifts. */
#ifndef INKLOOP_PLAN_SEARCH_H
#define INKLOOP_PLAN_SEARCH_H

#include "plan_surface.h"

/* Improves the plan of the surface. The result is never worse than the start: the best plan at the end of a sweep is
 * kept, and evaluated. Counts its work in `report`; ends at the `deadline` by the stopwatch. Returns CORE_DONE (none of
 * the requested moves helps), CORE_BUDGET, CORE_TIME, CORE_STOPPED or CORE_NO_MEMORY. */
int32_t plan_search(PlanSurface *surface, const SearchOptions *options, double deadline, SearchReport *report);

#endif
