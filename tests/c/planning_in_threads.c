/* Plans one horizon on a grid of 3 x 3 tiles with one thread and with four: the same bits. Prints what differs and ends
 * with 1. Built with -fsanitize=thread, it reports races between the tiles too. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "counter_random.h"
#include "horizon_planner.h"
#include "tiled_sweep.h"

/* Three cells from the last column of a row on are the first column of the next one, which is another tile's. */
enum { WIDTH = 2 * TILE + 9, CELLS = WIDTH * WIDTH, LAYERS = 2, PLACES = LAYERS * CELLS };

static double height[CELLS], target[CELLS], weight[CELLS];
static uint8_t part[CELLS];
static uint16_t choices[PLACES];
static int32_t alone[PLACES], together[PLACES];

static HorizonProblem rough_surface(double alpha) {
    for (size_t cell = 0; cell < CELLS; cell++) {
        height[cell] = 4e-4 + 1.2e-5 * random_unit(1, cell);
        target[cell] = 4e-4 + 1.4e-5;
        weight[cell] = 1.0;
        part[cell] = 1;
    }
    for (size_t place = 0; place < PLACES; place++)
        choices[place] = 3;
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

static PlanReport planned(const HorizonProblem *problem, int32_t threads, int32_t plan[PLACES]) {
    const PlanWork work = {.relaxation = RELAX_HERE,
                           .sweeps = 3,
                           .annealing_sweeps = 1,
                           .iterations = 2,
                           .seed = 5,
                           .seconds_max = INFINITY,
                           .threads = threads};
    PlanReport report;
    if (plan_horizon(problem, &work, plan, &report) != CORE_DONE)
        report.status = PLAN_STOPPED;
    return report;
}

static const char *difference(double alpha) {
    const HorizonProblem problem = rough_surface(alpha);
    const PlanReport one = planned(&problem, 1, alone), four = planned(&problem, 4, together);
    if ((one.status != PLAN_REPAIRED && one.status != PLAN_BUDGET) || one.sweeps == 0)
        return "nothing was planned";
    if (one.status != four.status || one.start != four.start || one.sweeps != four.sweeps)
        return "the ways to the plan";
    if (memcmp(&one.objective, &four.objective, sizeof one.objective) != 0)
        return "the objectives";
    return memcmp(alone, together, sizeof alone) != 0 ? "the droplets" : NULL;
}

int main(void) {
    static const double ALPHAS[] = {0.8, 1.0}; /* tiles that share one sum, and tiles that share nothing */
    for (size_t k = 0; k < 2; k++) {
        const char *differs = difference(ALPHAS[k]);
        if (differs) {
            printf("one thread and four, alpha %g: %s\n", ALPHAS[k], differs);
            return 1;
        }
    }
    return 0;
}
