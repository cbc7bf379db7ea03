#include "step_state.h"

#include <math.h>
#include <string.h>

enum { STOP_ON_DOUBT = 1 }; /* value of OnDoubt in variables.toml */

static size_t grid_of(const StateHead *head) {
    return (size_t)(head->nx * head->ny);
}

size_t state_size(size_t cells, size_t layers) {
    return sizeof(StateHead) + estimate_size(cells) + layers * cells * sizeof(int32_t);
}

SurfaceEstimate state_estimate(void *state) {
    StateHead *head = state;
    return estimate_in(head + 1, grid_of(head));
}

int32_t *state_plan(void *state) {
    StateHead *head = state;
    return (int32_t *)((char *)(head + 1) + estimate_size(grid_of(head)));
}

SurfaceEstimate known_estimate(const void *state) {
    return state_estimate((void *)state);
}

const int32_t *last_plan(const void *state) {
    return state_plan((void *)state);
}

StateHead start_head(const LayerStep *step, size_t layers, int32_t layer_command) {
    return (StateHead){.nx = *step->values->nx,
                       .ny = *step->values->ny,
                       .layers = layers,
                       .layer_command = layer_command,
                       .estimated = NO_SCAN,
                       .answered = NO_SCAN,
                       .plan = {.bound = NAN, .bound_confidence = 1.0}};
}

void state_start(const LayerStep *step, size_t layers, int32_t layers_printed, void *state) {
    memset(state, 0, state_size(cells_of(step), layers));
    *(StateHead *)state = start_head(step, layers, layers_printed);
}

size_t state_layers(const LayerStep *step, const void *state, size_t size) {
    const StateHead *head = state;
    const size_t cells = cells_of(step);
    if (size < sizeof *head || head->nx != *step->values->nx || head->ny != *step->values->ny)
        return 0;
    return head->layers <= size / cells && size == state_size(cells, (size_t)head->layers) ? (size_t)head->layers : 0;
}

bool is_stopped(const LayerStep *step, const void *state) {
    const StateHead *head = state;
    return *step->values->on_doubt == STOP_ON_DOUBT && head->estimated != NO_SCAN &&
           known_estimate(state).known->trust.stop != 0;
}
