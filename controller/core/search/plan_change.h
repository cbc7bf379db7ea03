/* What a few changed values of a plan do to the surfaces: tried without a trace, or made.
 *
 * A change raises or lowers the nine cells around it in its own step. Every later step carries the difference one cell
 * further, because what flows between two cells depends on both of their heights. So a step is printed again in a
 * window that grows by one cell each way, and nowhere else. */
#ifndef INKLOOP_PLAN_CHANGE_H
#define INKLOOP_PLAN_CHANGE_H

#include "box.h"
#include "plan_surface.h"

/* Room for the window of one thread. */
typedef struct {
    size_t side;   /* from row to row */
    bool is_even;  /* droplets of all kinds have the same slopes */
    double *after; /* surface after the step */
    double *before;
    double *spread[2]; /* what its droplet gives to a neighbour at most: side, corner [m] */
    double *slope[2];
    double *chance; /* in the last step, what each cell's droplet leaves to chance [m] */
    uint8_t *value; /* of the droplet jetted on each cell in the step */
    int64_t work;   /* cells printed so far, in all trials */
    void *memory;
} Window;

bool window_open(Window *window, const PlanSurface *surface);
void window_close(Window *window);

/* What the changes add to the sums. They are on cells that touch or are the same. */
Sums plan_trial(const PlanSurface *surface, const Change *change, size_t count, Window *window);

/* Whether nothing but the cost counts, and plan_trial_worth leaves out the sums of heights. */
static inline bool is_cost_enough(const PlanSurface *surface) {
    return surface->steps == 1 && surface->weighting.alpha == 1.0;
}

/* As plan_trial, as far as the objective depends on it. */
Sums plan_trial_worth(const PlanSurface *surface, const Change *change, size_t count, Window *window);

/* Makes the changes: plan and surfaces, not the sums. Returns the box of their maps outside of which nothing changed;
 * an empty one if there is a single step. */
Box plan_apply(PlanSurface *surface, const Change *change, size_t count, Window *window);

#endif
