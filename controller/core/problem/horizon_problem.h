/* The layer problem over a horizon: which droplets to jet in the next layers, so that the surface after the last of
 * them comes close to the target.
 *
 * A grid is nx * ny cells in C order, cell (i, j) at i * ny + j; heights in metres. A droplet is of a kind: an ink, or
 * on a grey head an ink in a drop size. A plan is layers * nx * ny values: 0 nothing, 1 + k a droplet of kind k. */
#ifndef INKLOOP_HORIZON_PROBLEM_H
#define INKLOOP_HORIZON_PROBLEM_H

#include <stddef.h>
#include <stdint.h>

#include "layer_map.h"

enum { HORIZON_MAX = 5, KINDS_MAX = 16 };

typedef struct {
    size_t nx, ny;
    size_t layers;         /* the horizon, 1 to HORIZON_MAX */
    const double *height;  /* surface before the first layer [m] */
    const double *target;  /* target of the surface after the last layer [m] */
    const double *ceiling; /* limit of the last surface [m]; NULL: none */
    const uint8_t *part;   /* cells whose standard deviation counts; at least one */
    /* weight of each cell's error: 1 in the part, less on a fringe around it, 0 elsewhere; NULL: no fringe */
    const double *weight;
    const uint16_t *choices; /* layers * nx * ny: bit k is set where a droplet of kind k may fall */
    size_t kinds;            /* 1 to KINDS_MAX */
    Ink kind[KINDS_MAX];     /* height added by a droplet of each kind */
    double alpha;            /* weight of the mean error against the standard deviation, 0 to 1 */
    double overshoot;        /* cost of a metre above the target relative to a metre below; > 0 */
    double ceiling_cost;     /* additional cost of a metre above the ceiling; >= 0 */
    /* standard deviation of a droplet's volume, as a share of it: the uncertainty of the last droplets counts
     * (plan_surface.h); 0: the prediction alone */
    double droplet_std;
    int32_t passes;                  /* 1, or 4 in a 2x2 colouring, each on the surface after the last one */
    int32_t colours[HORIZON_MAX][4]; /* for 4 passes: the cell_colour of each pass of each layer */
} HorizonProblem;

static inline double cell_weight(const HorizonProblem *problem, size_t cell) {
    return problem->weight ? problem->weight[cell] : problem->part[cell] ? 1.0 : 0.0;
}

/* Objective of a plan and its parts, over the cells of the surface after the last layer [m]: value = alpha * (error +
 * over_ceiling) + (1 - alpha) * deviation. */
typedef struct {
    double value;
    /* expected value of the weighted mean of the height below the target plus `overshoot` times the height above it */
    double error;
    double over_ceiling; /* weighted mean of the height above the ceiling, times ceiling_cost */
    double deviation;    /* expected population standard deviation over the part */
} Objective;

enum { MOVE_FLIPS = 1, MOVE_SWAPS = 2, MOVE_SHIFTS = 4, MOVES_ALL = 7 };
enum {
    CORE_DONE = 0,
    CORE_BUDGET = 1,
    CORE_TIME = 2,
    CORE_STOPPED = 3,
    CORE_NO_MEMORY = 4,
    CORE_NO_SCAN = 5,
    CORE_NO_DEVICE = 6
};

typedef struct {
    Objective objective; /* objective of the present plan, or of the one returned, evaluated from scratch */
    double incremental;  /* value from the running sums [m] */
    int64_t sweeps, evaluations;
    /* changes made: another droplet on a cell, a swap with a neighbour, a move to another layer */
    int64_t flips, swaps, shifts;
} SearchReport;

/* Called after each sweep; not 0: stop here. */
typedef int32_t AfterSweep(void *caller, const SearchReport *so_far);

typedef struct {
    int32_t moves;            /* MOVE_... allowed in the descent */
    int64_t annealing_sweeps; /* sweeps before the descent; 0: none */
    int64_t sweeps_max;       /* limit of sweeps in the descent */
    uint64_t seed;            /* seed of the annealing */
    double seconds_max;       /* time limit; infinite: none */
    int32_t threads;          /* 1 or more; the bits of the answer do not depend on it */
    AfterSweep *after_sweep;  /* NULL: none */
    void *caller;
} SearchOptions;

/* A search elsewhere, with the meaning of improve_plan (horizon_solver.h). Of the report it fills the sweeps;
 * CORE_NO_DEVICE: it has failed, and the plan is as before. */
typedef int32_t DeviceSearch(const HorizonProblem *problem, const SearchOptions *options, int32_t *plan,
                             SearchReport *report);

typedef struct {
    int64_t iterations_max;
    double seconds_max;
    int32_t threads; /* 1 or more; the bits of the answer do not depend on it */
} RelaxationOptions;

typedef struct {
    double value; /* smoothed objective of the droplets returned [m] */
    int64_t iterations;
} RelaxationReport;

#endif
