/* Steps that take time: homing, moving, purging, a pass, a cure, a scan. One at a time. */
#ifndef INKLOOP_STEPS_H
#define INKLOOP_STEPS_H

#include "node_state.h"

/* Records the INTENT of a step that is allowed now; the next tick energises. `option`: colour of a pass, milliseconds
 * of a cure, station of a move. CAUSE_NONE, or the cause why it must be abandoned. */
Cause steps_begin(Node *node, StepKind kind, uint16_t routine, const Key *key, uint16_t option);

/* Continues the step; its answer is ready when it has ended. CAUSE_NONE, or the cause why it must be abandoned. */
Cause steps_continue(Node *node);

/* Abandons the step and answers that it failed. The caller switches the actuators off. */
void steps_give_up(Node *node);

/* Whether the DONE of a step is in the journal. */
bool steps_is_done(const Node *node, const Step *step);

#endif
