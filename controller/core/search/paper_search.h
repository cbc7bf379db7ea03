/* The stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C), the baseline to compare with.
 *
 * A random batch of M cells is drawn; each flip is tried alone against the present pattern; all that lower the
 * objective alone are flipped together. The paper leaves open that together they may raise it: such a batch is undone
 * and M halved. A pass draws every allowed place, a cell of a layer, once, without repetition. When a pass has flipped
 * nothing, no single flip helps, which is the paper's end at M = 1. The paper plans one layer, with one kind of droplet
 * on each cell; here the plan may have more layers. */
#ifndef INKLOOP_PAPER_SEARCH_H
#define INKLOOP_PAPER_SEARCH_H

#include "plan_change.h"

/* `order` and `marked` hold layers * nx * ny each. A batch is an iteration; at most `iterations_max`. Sweeps count
 * passes. Returns CORE_DONE or CORE_BUDGET. */
int32_t paper_search(PlanSurface *surface, size_t batch, int64_t iterations_max, uint64_t seed, size_t *order,
                     size_t *marked, Window *window, SearchReport *report);

#endif
