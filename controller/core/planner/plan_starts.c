#include "plan_starts.h"

#include <string.h>

#include "drop_levels.h"
#include "row_ranges.h"

static size_t cells_of(const HorizonProblem *problem) {
    return problem->nx * problem->ny;
}

static int32_t first_value(const HorizonProblem *problem, uint16_t choices) {
    const uint8_t kind = first_kind(problem, choices);
    return kind == NO_KIND ? 0 : 1 + kind;
}

static bool may_fall(uint16_t choices, int32_t value) {
    return value == 0 || (choices >> (value - 1) & 1);
}

/* The droplet if allowed, else the first kind allowed in its place. */
static int32_t allowed(const HorizonProblem *problem, uint16_t choices, int32_t value) {
    return may_fall(choices, value) ? value : first_value(problem, choices);
}

/* A start that is filled row by row: droplets, or a plan from another one, `of`, of so many layers. */
typedef struct {
    const HorizonProblem *problem;
    double *droplets;
    int32_t *plan;
    const int32_t *of;
    size_t layers;
} Start;

static void fill(const Start *start, int32_t threads, RowWork *rows) {
    run_rows((size_t)threads, start->problem->nx, start->problem->ny, rows, (void *)start);
}

static void fill_full(void *context, const RowRange *range) {
    const Start *start = context;
    const HorizonProblem *problem = start->problem;
    for (size_t layer = 0; layer < problem->layers; layer++)
        for (size_t cell = range->top * problem->ny; cell < range->bottom * problem->ny; cell++) {
            const size_t place = layer * cells_of(problem) + cell;
            start->plan[place] = first_value(problem, problem->choices[place]);
        }
}

void full_layers(const HorizonProblem *problem, int32_t threads, int32_t *plan) {
    fill(&(Start){.problem = problem, .plan = plan}, threads, fill_full);
}

static void fill_evenly(void *context, const RowRange *range) {
    const Start *start = context;
    const HorizonProblem *problem = start->problem;
    const Ink *first = &problem->kind[0];
    const double full = (double)problem->layers * (first->h1 + 4.0 * first->h2 + 4.0 * first->h3);
    for (size_t layer = 0; layer < problem->layers; layer++)
        for (size_t cell = range->top * problem->ny; cell < range->bottom * problem->ny; cell++) {
            const size_t place = layer * cells_of(problem) + cell;
            const double lacking = (problem->target[cell] - problem->height[cell]) / full;
            const double within = lacking < 0.0 ? 0.0 : lacking > 1.0 ? 1.0 : lacking;
            start->droplets[place] = problem->choices[place] > 0 ? within : 0.0;
        }
}

void even_droplets(const HorizonProblem *problem, int32_t threads, double *droplets) {
    fill(&(Start){.problem = problem, .droplets = droplets}, threads, fill_evenly);
}

static void fill_shifted(void *context, const RowRange *range) {
    const Start *start = context;
    const HorizonProblem *problem = start->problem;
    const size_t cells = cells_of(problem);
    for (size_t layer = 0; layer < problem->layers; layer++) {
        const int32_t *from = start->of + (layer + 1 < start->layers ? layer + 1 : start->layers - 1) * cells;
        for (size_t cell = range->top * problem->ny; cell < range->bottom * problem->ny; cell++) {
            const size_t place = layer * cells + cell;
            start->plan[place] = may_fall(problem->choices[place], from[cell]) ? from[cell] : 0;
        }
    }
}

void shift_plan(const HorizonProblem *problem, int32_t threads, const int32_t *last, size_t last_layers,
                int32_t *plan) {
    fill(&(Start){.problem = problem, .plan = plan, .of = last, .layers = last_layers}, threads, fill_shifted);
}

static void fill_postponed(void *context, const RowRange *range) {
    const Start *start = context;
    const HorizonProblem *problem = start->problem;
    const size_t cells = cells_of(problem), first = problem->layers + 1 - start->layers;
    for (size_t layer = 0; layer < problem->layers; layer++)
        for (size_t cell = range->top * problem->ny; cell < range->bottom * problem->ny; cell++) {
            const size_t place = layer * cells + cell;
            const int32_t value = layer < first ? 0 : start->of[(layer + 1 - first) * cells + cell];
            start->plan[place] = may_fall(problem->choices[place], value) ? value : 0;
        }
}

void postpone_plan(const HorizonProblem *problem, int32_t threads, const int32_t *last, size_t last_layers,
                   int32_t *plan) {
    fill(&(Start){.problem = problem, .plan = plan, .of = last, .layers = last_layers}, threads, fill_postponed);
}

static void fill_squeezed(void *context, const RowRange *range) {
    const Start *start = context;
    const HorizonProblem *problem = start->problem;
    const size_t cells = cells_of(problem), places = problem->layers * cells;
    for (size_t cell = range->top * problem->ny; cell < range->bottom * problem->ny; cell++) {
        for (size_t place = cell; place < places; place += cells)
            start->plan[place] = allowed(problem, problem->choices[place], start->of[cells + place]);
        size_t place = cell;
        while (place < places && (start->plan[place] != 0 || problem->choices[place] == 0))
            place += cells;
        if (place < places)
            start->plan[place] = allowed(problem, problem->choices[place], start->of[cell]);
    }
}

void squeeze_plan(const HorizonProblem *problem, int32_t threads, const int32_t *longer, int32_t *plan) {
    fill(&(Start){.problem = problem, .plan = plan, .of = longer}, threads, fill_squeezed);
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
            moved[place] = allowed(problem, problem->choices[place], from[cell]);
        }
    }
    memcpy(plan, moved, layers * cells * sizeof(int32_t));
    return true;
}
