#include "plan_starts.h"

#include <string.h>

static size_t cells_of(const HorizonProblem *problem) {
    return problem->nx * problem->ny;
}

static int32_t first_value(uint16_t choices) {
    int32_t value = 0;
    for (int32_t kind = KINDS_MAX; kind-- > 0;)
        if (choices >> kind & 1)
            value = kind + 1;
    return value;
}

static bool may_fall(uint16_t choices, int32_t value) {
    return value == 0 || (choices >> (value - 1) & 1);
}

/* The droplet if allowed, else the first kind allowed in its place. */
static int32_t allowed(uint16_t choices, int32_t value) {
    return may_fall(choices, value) ? value : first_value(choices);
}

void full_layers(const HorizonProblem *problem, int32_t *plan) {
    for (size_t place = 0; place < problem->layers * cells_of(problem); place++)
        plan[place] = first_value(problem->choices[place]);
}

void even_droplets(const HorizonProblem *problem, double *droplets) {
    const size_t cells = cells_of(problem);
    const Ink *first = &problem->kind[0];
    const double full = (double)problem->layers * (first->h1 + 4.0 * first->h2 + 4.0 * first->h3);
    for (size_t place = 0; place < problem->layers * cells; place++) {
        const double lacking = (problem->target[place % cells] - problem->height[place % cells]) / full;
        const double within = lacking < 0.0 ? 0.0 : lacking > 1.0 ? 1.0 : lacking;
        droplets[place] = problem->choices[place] > 0 ? within : 0.0;
    }
}

void shift_plan(const HorizonProblem *problem, const int32_t *last, size_t last_layers, int32_t *plan) {
    const size_t cells = cells_of(problem);
    for (size_t layer = 0; layer < problem->layers; layer++) {
        const size_t ahead = layer + 1 < last_layers ? layer + 1 : last_layers - 1;
        for (size_t cell = 0; cell < cells; cell++) {
            const int32_t value = last[ahead * cells + cell];
            plan[layer * cells + cell] = may_fall(problem->choices[layer * cells + cell], value) ? value : 0;
        }
    }
}

void postpone_plan(const HorizonProblem *problem, const int32_t *last, size_t last_layers, int32_t *plan) {
    const size_t cells = cells_of(problem), places = problem->layers * cells, rest = (last_layers - 1) * cells;
    for (size_t place = 0; place < places; place++) {
        const int32_t value = place + rest < places ? 0 : last[cells + place + rest - places];
        plan[place] = may_fall(problem->choices[place], value) ? value : 0;
    }
}

void squeeze_plan(const HorizonProblem *problem, const int32_t *longer, int32_t *plan) {
    const size_t cells = cells_of(problem), places = problem->layers * cells;
    for (size_t place = 0; place < places; place++)
        plan[place] = allowed(problem->choices[place], longer[cells + place]);
    for (size_t cell = 0; cell < cells; cell++) {
        size_t place = cell;
        while (place < places && (plan[place] != 0 || problem->choices[place] == 0))
            place += cells;
        if (place < places)
            plan[place] = allowed(problem->choices[place], longer[cell]);
    }
}

static bool is_idle(const int32_t *layer, size_t cells) {
    for (size_t cell = 0; cell < cells; cell++)
        if (layer[cell] > 0)
            return false;
    return true;
}

bool leave_idle_start(const HorizonProblem *problem, int32_t *plan, int32_t *moved) {
    const size_t cells = cells_of(problem), layers = problem->layers;
    size_t idle = 0;
    while (idle < layers && is_idle(plan + idle * cells, cells))
        idle++;
    if (idle == 0 || idle == layers)
        return false;
    for (size_t layer = 0; layer < layers; layer++) {
        const int32_t *from = plan + (layer + idle) % layers * cells;
        for (size_t cell = 0; cell < cells; cell++) {
            const size_t place = layer * cells + cell;
            moved[place] = allowed(problem->choices[place], from[cell]);
        }
    }
    memcpy(plan, moved, layers * cells * sizeof(int32_t));
    return true;
}
