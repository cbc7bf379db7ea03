#include "full_plan.h"

#include <math.h>

static const double SAME_SHAPE = 1e-9; /* difference of shares below which inks are drops of one ink (assumed) */

static const double ROUNDED = 1e-12; /* bound of the rounding of a surface [m] */

static bool is_same_shape(const Ink *one, const Ink *other) {
    const double scale = one->h1 / other->h1;
    return fabs(scale * other->h2 - one->h2) <= SAME_SHAPE * one->h2 &&
           fabs(scale * other->h3 - one->h3) <= SAME_SHAPE * one->h3;
}

/* 1 + the largest kind among the choices, 0 if there is none; false if no kind is the largest in every part. */
static bool largest_kind(const HorizonProblem *problem, uint16_t choices, int32_t *value) {
    *value = 0;
    for (size_t kind = 0; kind < problem->kinds; kind++) {
        if (!(choices >> kind & 1))
            continue;
        if (*value && !is_same_shape(&problem->kind[kind], &problem->kind[*value - 1]))
            return false;
        if (!*value || problem->kind[kind].h1 > problem->kind[*value - 1].h1)
            *value = 1 + (int32_t)kind;
    }
    return true;
}

/* Whether full layers alone, without shares of neighbours, exceed the target of a cell that counts. */
static bool is_passed(const HorizonProblem *problem, const int32_t *plan) {
    const size_t cells = problem->nx * problem->ny;
    for (size_t cell = 0; cell < cells; cell++) {
        double least = problem->height[cell] - ROUNDED;
        for (size_t layer = 0; layer < problem->layers; layer++) {
            const int32_t value = plan[layer * cells + cell];
            least += value ? problem->kind[value - 1].h1 : 0.0;
        }
        if (least > problem->target[cell] && cell_weight(problem, cell) > 0.0)
            return true;
    }
    return false;
}

bool fullest_plan(const HorizonProblem *problem, int32_t *plan) {
    for (size_t kind = 0; kind < problem->kinds; kind++) {
        const Droplet droplet = droplet_of(&problem->kind[kind]);
        if (4.0 * (droplet.slope[SIDE] + droplet.slope[CORNER]) > 1.0)
            return false;
    }
    for (size_t place = 0; place < problem->layers * problem->nx * problem->ny; place++)
        if (!largest_kind(problem, problem->choices[place], &plan[place]))
            return false;
    return !is_passed(problem, plan);
}

/* Largest decrease of the expected squares by a lower surface, as a height above the mean [m]: at most the w of a
 * droplet left out, w^2 / 3 per height of that droplet, and w / 3 for the neighbours' contribution to w. */
static double chance_above_mean(const PlanSurface *surface) {
    double largest = 0.0, smallest = INFINITY;
    for (size_t cell = 0; cell < surface->framed; cell++)
        largest = fmax(largest, surface->inside[cell] * surface->left_to_chance[cell]);
    for (size_t kind = 0; kind < surface->problem->kinds; kind++)
        smallest = fmin(smallest, surface->problem->kind[kind].h1);
    return largest * largest / (3.0 * smallest) + surface->chance * largest / 3.0;
}

bool is_fullest_best(const PlanSurface *surface) {
    const double *last = surface_height(surface, surface->steps), alpha = surface->weighting.alpha;
    const double mean = surface->reference + surface->sums.height / surface->weighting.count;
    const double spread = deviation(&surface->sums, &surface->weighting), chance = chance_above_mean(surface);
    for (size_t cell = 0; cell < surface->framed; cell++) {
        const double weight = surface->weight[cell], above = surface->inside[cell] * (last[cell] - mean + chance);
        const double top = last[cell] + surface->left_to_chance[cell];
        if (weight > 0.0 && (top > surface->target[cell] || (surface->ceiling && top > surface->ceiling[cell])))
            return false;
        if (alpha * weight * spread < (1.0 - alpha) * above)
            return false;
    }
    return true;
}
