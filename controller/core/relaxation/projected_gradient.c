#include "projected_gradient.h"

#include <stdlib.h>
#include <string.h>

#include "drop_levels.h"
#include "stopwatch.h"

/* Smoothing, found by trial on random rough and nearly flat printed surfaces of 20 to 100 cells a side, horizons 1 to
 * 3: 30 iterations from the first to the last value end within 0.01 um of the optimum, except under a ceiling that
 * binds. */
static const double SMOOTHING_FIRST = 0.3;  /* of a droplet's height */
static const double SMOOTHING_LAST = 0.003; /* of a droplet's height */

typedef struct {
    double *start;    /* the start */
    double *ahead;    /* the droplets with their momentum, where the gradient is taken */
    double *limit;    /* the largest drop allowed */
    double *gradient; /* [m] */
    double momentum;
} Descent;

static double within(double value, double limit) {
    return value < 0.0 ? 0.0 : value > limit ? limit : value;
}

/* The largest height of a droplet in all: the length that smoothing and steps are measured by [m]. */
static double unit_height(const HorizonProblem *problem) {
    double largest = 0.0;
    for (size_t kind = 0; kind < problem->kinds; kind++)
        largest = fmax(largest, drop_height(&problem->kind[kind]));
    return largest;
}

/* A step against the gradient with momentum; momentum that has led uphill is reset. */
static void take_step(Descent *descent, double step, double *droplets, size_t places) {
    const double next = 0.5 * (1.0 + sqrt(1.0 + 4.0 * descent->momentum * descent->momentum));
    const double onward = (descent->momentum - 1.0) / next;
    double uphill = 0.0;
    for (size_t place = 0; place < places; place++) {
        const double limit = descent->limit[place];
        const double moved = within(descent->ahead[place] - step * descent->gradient[place], limit);
        const double change = moved - droplets[place];
        uphill += descent->gradient[place] * change;
        droplets[place] = moved;
        descent->ahead[place] = within(moved + onward * change, limit);
    }
    descent->momentum = next;
    if (uphill > 0.0) {
        descent->momentum = 1.0;
        memcpy(descent->ahead, droplets, places * sizeof(double));
    }
}

int32_t projected_gradient(RelaxedSurface *surface, const RelaxationOptions *options, double *droplets,
                           RelaxationReport *report) {
    const HorizonProblem *problem = surface->problem;
    const size_t places = problem->layers * problem->nx * problem->ny, bytes = places * sizeof(double);
    const double began = stopwatch_seconds(), unit = unit_height(problem), last = SMOOTHING_LAST * unit;
    const double shrink = pow(SMOOTHING_LAST / SMOOTHING_FIRST, 1.0 / fmax(1.0, (double)options->iterations_max));
    int32_t status = CORE_DONE;
    *report = (RelaxationReport){0};
    double *memory = malloc(4 * bytes);
    if (!memory)
        return CORE_NO_MEMORY;
    Descent descent = {memory, memory + places, memory + 2 * places, memory + 3 * places, 1.0};
    for (size_t place = 0; place < places; place++) {
        descent.limit[place] = drop_level_max(problem, problem->choices[place]);
        droplets[place] = within(droplets[place], descent.limit[place]);
    }
    memcpy(descent.start, droplets, bytes);
    memcpy(descent.ahead, droplets, bytes);
    surface->ends_at = began + options->seconds_max;
    const double opened = stopwatch_seconds();
    double before = INFINITY;
    if (!relaxed_value(surface, descent.start, last, &before))
        status = CORE_TIME;
    const double valued = stopwatch_seconds(), ends_at = surface->ends_at - (valued - opened);
    double smoothing = SMOOTHING_FIRST * unit, latest = valued,
           iteration = 2.0 * (valued - opened); /* first estimate */
    for (; status == CORE_DONE && report->iterations < options->iterations_max; report->iterations++) {
        if (latest + iteration > ends_at) { /* another iteration would end too late for the final value */
            status = CORE_TIME;
            break;
        }
        double ahead;
        if (!relaxed_value(surface, descent.ahead, smoothing, &ahead) ||
            !relaxed_gradient(surface, descent.ahead, smoothing, descent.gradient)) {
            status = CORE_TIME;
            break;
        }
        /* Inverse curvature of the smoothed objective, if every droplet moves the error of its cell. */
        const double step = smoothing * surface->count / (unit * unit * (double)problem->layers);
        take_step(&descent, step, droplets, places);
        smoothing *= shrink;
        const double now = stopwatch_seconds();
        iteration = fmax(iteration, now - latest);
        latest = now;
    }
    const bool is_valued = relaxed_value(surface, droplets, last, &report->value);
    if (!is_valued)
        status = CORE_TIME;
    if (!is_valued || before < report->value) {
        memcpy(droplets, descent.start, bytes);
        report->value = before;
    }
    free(memory);
    return status;
}
