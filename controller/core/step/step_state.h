/* The state of a layer controller: one block of bytes without addresses. It holds the numbers of the handshake, the
 * report of the last plan, the estimate and the plan. A checkpoint and the state of an FMU contain it unchanged. */
#ifndef INKLOOP_STEP_STATE_H
#define INKLOOP_STEP_STATE_H

#include "horizon_planner.h"
#include "step_options.h"

/* Figures of a plan. */
typedef struct {
    int32_t status;   /* PLAN_...; 0: its objective is the bound, 6: settled by a rule, without an objective */
    int32_t left_out; /* LEFT_..., and 16: the certificate */
    int64_t sweeps;
    Objective objective;     /* [m] */
    double bound;            /* lower bound of the objective of any plan [m]; NaN: none is known */
    double bound_confidence; /* probability that it holds; 1: proven */
    double seconds;          /* time from the scan to the plan */
} PlanFigures;

/* The head of a state, before the estimate and the plan. Without padding. */
typedef struct {
    uint64_t nx, ny, layers; /* size of the plan */
    int64_t layer_command;
    int64_t estimated; /* number of the scan of the estimate */
    int64_t answered;  /* number of the scan that was answered last, by a plan or by a stop */
    PlanFigures plan;
} StateHead;

enum { NO_SCAN = -1 };

/* Size of a state with a plan of `layers` [bytes]. */
size_t state_size(size_t cells, size_t layers);

/* The head before the first scan. */
StateHead start_head(const LayerStep *step, size_t layers, int32_t layer_command);

/* The state before the first scan: commands count from `layers_printed`. */
void state_start(const LayerStep *step, size_t layers, int32_t layers_printed, void *state);

/* The number of layers of the plan in a state of this grid and size; 0: it is no such state. */
size_t state_layers(const LayerStep *step, const void *state, size_t size);

/* Estimate and plan (layers * nx * ny) in a state; the same in a state that is only read. */
SurfaceEstimate state_estimate(void *state);
int32_t *state_plan(void *state);
SurfaceEstimate known_estimate(const void *state);
const int32_t *last_plan(const void *state);

/* Whether the print is stopped because the scans do not show it. */
bool is_stopped(const LayerStep *step, const void *state);

/* Material of a droplet of a plan, 1 or 2, and its number of drops; 0 and 1 for none. */
static inline int32_t material_of(int32_t droplet, int32_t inks) {
    return droplet <= inks ? droplet : 1 + (droplet - 1) % inks; /* a single drop has only the number of its ink */
}

static inline int32_t drops_of(int32_t droplet, int32_t inks) {
    return droplet <= inks ? 1 : 1 + (droplet - 1) / inks;
}

#endif
