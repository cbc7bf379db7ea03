/* The outputs of a controller, as variables.toml declares them, from a state. */
#ifndef INKLOOP_STEP_OUTPUTS_H
#define INKLOOP_STEP_OUTPUTS_H

#include "step_state.h"

/* Writes all outputs before the first scan: nothing is estimated, and nothing is jetted. */
void start_outputs(const LayerStep *step, int32_t layer_command);

/* Writes all outputs. `estimated_height` may be the height of the state itself. */
void step_outputs(const LayerStep *step, const void *state);

#endif
