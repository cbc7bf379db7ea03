#include "full_plan.h"

#include <math.h>

#include "row_ranges.h"

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

/* A plan, or the surface of one, that is tested row by row; has_failed: in the rows of a thread. */
typedef struct {
    const HorizonProblem *problem;
    size_t threads;
    const PlanSurface *surface;
    int32_t *plan;
    double mean, spread, chance;
    double largest[CHUNKS];
    bool has_failed[CHUNKS];
} Test;

/* Calls `rows` for all rows; false if a test has failed. */
static bool pass(Test *test, RowWork *rows) {
    bool has_failed = false;
    run_rows(test->threads, test->problem->nx, test->problem->ny, rows, test);
    for (size_t k = 0; k < CHUNKS; k++)
        has_failed = has_failed || test->has_failed[k];
    return !has_failed;
}

/* Fills the cells; fails where full layers alone, without shares of neighbours, exceed the target of a cell that
 * counts. */
static void fill_rows(void *context, const RowRange *range) {
    Test *test = context;
    const HorizonProblem *problem = test->problem;
    const size_t cells = problem->nx * problem->ny;
    bool *has_failed = &test->has_failed[range->thread];
    for (size_t cell = range->top * problem->ny; cell < range->bottom * problem->ny && !*has_failed; cell++) {
        double least = problem->height[cell] - ROUNDED;
        for (size_t place = cell; place < problem->layers * cells && !*has_failed; place += cells) {
            int32_t *value = &test->plan[place];
            *has_failed = !largest_kind(problem, problem->choices[place], value);
            least += *value ? problem->kind[*value - 1].h1 : 0.0;
        }
        *has_failed = *has_failed || (least > problem->target[cell] && cell_weight(problem, cell) > 0.0);
    }
}

bool fullest_plan(const HorizonProblem *problem, int32_t threads, int32_t *plan) {
    for (size_t kind = 0; kind < problem->kinds; kind++) {
        const Droplet droplet = droplet_of(&problem->kind[kind]);
        if (4.0 * (droplet.slope[SIDE] + droplet.slope[CORNER]) > 1.0)
            return false;
    }
    return pass(&(Test){.problem = problem, .threads = (size_t)threads, .plan = plan}, fill_rows);
}

static void find_largest(void *context, const RowRange *range) {
    Test *test = context;
    const PlanSurface *surface = test->surface;
    double largest = 0.0;
    for (size_t cell = surface_cell(surface, range->top, 0); cell < surface_cell(surface, range->bottom, 0); cell++)
        largest = fmax(largest, surface->inside[cell] * surface->left_to_chance[cell]);
    test->largest[range->thread] = largest;
}

/* Largest decrease of the expected squares by a lower surface, as a height above the mean [m]: at most the w of a
 * droplet left out, w^2 / 3 per height of that droplet, and w / 3 for the neighbours' contribution to w. */
static double chance_above_mean(Test *test) {
    const PlanSurface *surface = test->surface;
    double largest = 0.0, smallest = INFINITY;
    pass(test, find_largest);
    for (size_t k = 0; k < CHUNKS; k++)
        largest = fmax(largest, test->largest[k]);
    for (size_t kind = 0; kind < surface->problem->kinds; kind++)
        smallest = fmin(smallest, surface->problem->kind[kind].h1);
    return largest * largest / (3.0 * smallest) + surface->chance * largest / 3.0;
}

static void test_rows(void *context, const RowRange *range) {
    Test *test = context;
    const PlanSurface *surface = test->surface;
    const double *last = surface_height(surface, surface->steps), alpha = surface->weighting.alpha;
    bool *has_failed = &test->has_failed[range->thread];
    for (size_t cell = surface_cell(surface, range->top, 0);
         cell < surface_cell(surface, range->bottom, 0) && !*has_failed; cell++) {
        const double weight = surface->weight[cell], top = last[cell] + surface->left_to_chance[cell];
        const double above = surface->inside[cell] * (last[cell] - test->mean + test->chance);
        *has_failed =
            (weight > 0.0 && (top > surface->target[cell] || (surface->ceiling && top > surface->ceiling[cell]))) ||
            alpha * weight * test->spread < (1.0 - alpha) * above;
    }
}

bool is_fullest_best(const PlanSurface *surface) {
    Test test = {.problem = surface->problem,
                 .threads = surface->threads,
                 .surface = surface,
                 .mean = surface->reference + surface->sums.height / surface->weighting.count,
                 .spread = deviation(&surface->sums, &surface->weighting)};
    test.chance = chance_above_mean(&test);
    return pass(&test, test_rows);
}
