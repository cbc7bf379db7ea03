/* One step of the layer controller: the handshake of the layer contract, the estimate after a scan, the plan, the end.
 *
 * It goes by sequence numbers (docs/reference/layer-contract.md). A step reads the state before and writes the state
 * after into another block, so that an answer that fails changes nothing:
 *
 *     if (step_is_due(step, before)) {
 *         if (step_begin(step, before, after) == STEP_PLAN)
 *             step_plan(step, before, after, began);    or, by another planner, step_take
 *         step_outputs(step, after);
 *     }
 */
#ifndef INKLOOP_LAYER_STEP_H
#define INKLOOP_LAYER_STEP_H

#include "step_state.h"

/* STEP_ANSWERED: the state after is complete; STEP_PLAN: it lacks a plan; STEP_NO_SCAN: the first scan has too few
 * readings. */
enum { STEP_ANSWERED, STEP_PLAN, STEP_NO_MEMORY = CORE_NO_MEMORY, STEP_NO_SCAN = CORE_NO_SCAN };

/* Whether a step is due: a new scan of the layer commanded last, or a person has looked at a print that was stopped. */
bool step_is_due(const LayerStep *step, const void *state);

/* Handshake and estimate of a step that is due; returns STEP_.... The blocks `before` and `after` have the same
 * size. */
int32_t step_begin(const LayerStep *step, const void *before, void *after);

/* Plans by the core for a state that lacks a plan, beginning from the last one in `before`, and stores the plan. began:
 * arrival of the scan, by stopwatch_seconds. CORE_DONE, or CORE_NO_MEMORY and `after` is invalid. */
int32_t step_plan(const LayerStep *step, const void *before, void *after, double began);

/* Stores a plan (layers * nx * ny) in a state that lacks one. `after`: the same block, or another one for as many
 * layers. */
void step_take(const LayerStep *step, const void *before, const int32_t *plan, size_t layers,
               const PlanFigures *figures, void *after);

#endif
