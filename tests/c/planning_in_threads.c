/* Plans one horizon on a grid of 3 x 3 tiles with one thread and with four: the same bits. Prints what differs and ends
 * with 1. Built with -fsanitize=thread, it reports races between the tiles too. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "counter_random.h"
#include "horizon_planner.h"
#include "tiled_sweep.h"

/* Three cells from the last column of a row on are the first column of the next one, which is another tile's. */
enum { WIDTH = 2 * TILE + 9, LAYERS = 2 };
/* A grid whose rows are shared by four threads, and whose chunks are rounded apart. */
enum { ROWS = 1040, COLUMNS = 200, PLACES = ROWS * COLUMNS };

_Static_assert((int)PLACES > (int)LAYERS * WIDTH * WIDTH, "the larger one is the one with more rows");

static double height[PLACES], target[PLACES], weight[PLACES];
static uint8_t part[PLACES];
static uint16_t choices[PLACES];
static int32_t alone[PLACES], together[PLACES], last[PLACES];

static HorizonProblem rough_surface(double alpha) {
    for (size_t place = 0; place < PLACES; place++) {
        height[place] = 4e-4 + 1.2e-5 * random_unit(1, place);
        target[place] = 4e-4 + 1.4e-5;
        weight[place] = 1.0;
        part[place] = 1;
        choices[place] = 3;
        last[place] = 1;
    }
    return (HorizonProblem){.nx = WIDTH,
                            .ny = WIDTH,
                            .layers = LAYERS,
                            .height = height,
                            .target = target,
                            .part = part,
                            .weight = weight,
                            .choices = choices,
                            .kinds = 2,
                            .kind = {{4.4e-6, 0.6e-6, 0.2e-6}, {3.9e-6, 0.55e-6, 0.15e-6}},
                            .alpha = alpha,
                            .overshoot = 1.0,
                            .passes = 1};
}

/* A single layer of one ink on many rows, and one so far below the target that it is full. */
static HorizonProblem many_rows(double rise) {
    HorizonProblem problem = rough_surface(1.0);
    for (size_t place = 0; place < PLACES; place++) {
        choices[place] = 1;
        target[place] = height[place] + rise;
    }
    problem.nx = ROWS;
    problem.ny = COLUMNS;
    problem.layers = 1;
    problem.kinds = 1;
    return problem;
}

static PlanReport planned(const HorizonProblem *problem, int32_t threads, int32_t plan[PLACES]) {
    const PlanWork work = {.relaxation = RELAX_HERE,
                           .sweeps = 3,
                           .annealing_sweeps = 1,
                           .iterations = 2,
                           .seed = 5,
                           .seconds_max = INFINITY,
                           .threads = threads,
                           .last = problem->layers == 1 ? last : NULL,
                           .last_layers = 1};
    PlanReport report;
    if (plan_horizon(problem, &work, plan, &report) != CORE_DONE)
        report.status = PLAN_STOPPED;
    return report;
}

static const char *difference(const HorizonProblem *problem, bool is_full) {
    const PlanReport one = planned(problem, 1, alone), four = planned(problem, 4, together);
    if ((one.status != PLAN_REPAIRED && one.status != PLAN_BUDGET) || (one.sweeps == 0) != is_full)
        return "nothing was planned";
    if (one.status != four.status || one.start != four.start || one.sweeps != four.sweeps)
        return "the ways to the plan";
    if (memcmp(&one.objective, &four.objective, sizeof one.objective) != 0)
        return "the objectives";
    return memcmp(alone, together, sizeof alone) != 0 ? "the droplets" : NULL;
}

static int report(const char *surface, const char *differs) {
    if (differs)
        printf("one thread and four, %s: %s\n", surface, differs);
    return differs != NULL;
}

int main(void) {
    const HorizonProblem shared = rough_surface(0.8), apart = rough_surface(1.0);
    if (report("tiles that share one sum", difference(&shared, false)) ||
        report("tiles that share nothing", difference(&apart, false)))
        return 1;
    const HorizonProblem half = many_rows(2e-6);
    if (report("many rows", difference(&half, false)))
        return 1;
    const HorizonProblem full = many_rows(2e-5);
    return report("full layers", difference(&full, true));
}
