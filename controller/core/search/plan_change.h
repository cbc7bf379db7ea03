/* Effect of a few changed values of a plan on the surfaces: a trial that leaves no trace, or the change itself.
 *
 * A change raises or lowers the nine cells around it in its own step. Every later step propagates the difference one
 * cell further, because the flow between two cells depends on both of their heights. So a step is printed again in a
 * window that grows by one cell each way, and nowhere else. */
#ifndef INKLOOP_PLAN_CHANGE_H
#define INKLOOP_PLAN_CHANGE_H

#include "box.h"
#include "plan_surface.h"

/* Memory for the window of one thread. */
typedef struct {
    size_t side;   /* from row to row */
    bool is_even;  /* droplets of all kinds have the same slopes */
    double *after; /* surface after the step */
    double *before;
    double *spread[2]; /* largest share that each droplet gives to a neighbour: side, corner [m] */
    double *slope[2];
    double *chance; /* uncertainty of each cell's droplet in the last step [m] */
    uint8_t *value; /* value jetted on each cell in the step */
    int64_t work;   /* cells printed so far, in all trials */
    void *memory;
} Window;

bool window_open(Window *window, const PlanSurface *surface);
void window_close(Window *window);

/* Change of the sums by the changes, which are on cells that touch or are the same. */
Sums plan_trial(const PlanSurface *surface, const Change *change, size_t count, Window *window);

/* Whether the objective is the cost alone; then plan_trial_worth leaves out the sums of heights. */
static inline bool is_cost_enough(const PlanSurface *surface) {
    return surface->steps == 1 && surface->weighting.alpha == 1.0;
}

/* As plan_trial, but only the sums that the objective depends on. */
Sums plan_trial_worth(const PlanSurface *surface, const Change *change, size_t count, Window *window);

/* Executes the changes: plan and surfaces, not the sums. Returns the box of the maps that contains all differences; an
 * empty one if there is a single step. */
Box plan_apply(PlanSurface *surface, const Change *change, size_t count, Window *window);

#endif
