#include "layer_controller_variables.h"
#include "layer_step.h"
#include "layer_surface.h"
#include "passes.h"
#include "step_outputs.h"
#include "stopwatch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double HIGHEST = 0.5;       /* largest height that the search can represent [m] (lattice.h) */
static const double LARGEST_SHARE = 2.0; /* largest learnt share of a droplet's nominal height (register_fit.c) */

static LayerStep step_of(const LayerControllerVariables *v) {
    return (LayerStep){.values = v, .threads = 1};
}

/* Bytes of a state, which is kept in addition to the variables. */
static size_t kept_size(const LayerStep *step) {
    return state_size(cells_of(step), horizon_of(step, false));
}

static Outcome check_value(Instance *instance, size_t variable, const void *value) {
    return variable == LAYER_CONTROLLER_PASSES ? check_passes(instance, *(const int32_t *)value) : ACCEPTED;
}

/* Outputs before the first step; layer_command is 0 and not layers_printed, which the printer derives from this
 * command: that would be an algebraic loop. */
static void calculate(Instance *instance) {
    const LayerControllerVariables v = layer_controller_variables(instance);
    const LayerStep step = step_of(&v);
    start_outputs(&step, 0);
}

static Outcome initialize(Instance *instance) {
    const LayerControllerVariables v = layer_controller_variables(instance);
    const LayerStep step = step_of(&v);
    size_t part = 0;
    for (size_t cell = 0; cell < cells_of(&step); cell++)
        part += v.mask[cell];
    if (part == 0)
        return refuse(instance, "mask marks no cell; expected the cells of the part");
    if (*v.drop_levels * *v.inks > KINDS_MAX)
        return refuse(instance, "drop_levels is %ld with %ld inks; expected at most %d", (long)*v.drop_levels,
                      (long)*v.inks, KINDS_MAX / (int)*v.inks);
    void *kept = kept_memory(instance, kept_size(&step));
    if (!kept)
        return refuse(instance, "no memory for the plan of %lu cells", (unsigned long)cells_of(&step));
    state_start(&step, horizon_of(&step, false), 0, kept);
    step_outputs(&step, kept);
    return ACCEPTED;
}

static Outcome check_heights(Instance *instance, const LayerStep *step, const double *height) {
    const LayerControllerVariables *v = step->values;
    const InkPrior prior = nominal_inks(step);
    const double tallest = fmax(full_layer_height(&prior.nominal[0]), full_layer_height(&prior.nominal[1]));
    const size_t layers = horizon_of(step, false);
    const double room = HIGHEST - 2.0 * (double)layers * *v->drop_levels * LARGEST_SHARE * tallest;
    for (size_t cell = 0; cell < cells_of(step); cell++) {
        if (fabs(height[cell]) < room && v->target_height[cell] < room)
            continue;
        return refuse(instance,
                      "cell (%lu, %lu) is estimated at %g m, its target is %g m; expected heights within %g m with "
                      "%ld layers to come: count them from a surface near by",
                      (unsigned long)(cell / *v->ny), (unsigned long)(cell % *v->ny), height[cell],
                      v->target_height[cell], room, (long)layers);
    }
    return ACCEPTED;
}

enum { INTERVALS_MAX = 64 }; /* of region_intervals in variables.toml */

typedef struct {
    double bottom, top; /* bottom <= z < top */
} Interval;

/* The intervals of a cell, ascending, those that touch or overlap joined; returns their number. */
static size_t intervals_of(const LayerControllerVariables *v, size_t cell, Interval found[INTERVALS_MAX]) {
    const size_t cells = (size_t)(*v->nx * *v->ny);
    size_t count = 0, joined = 0;
    for (size_t map = 0; map < *v->region_intervals; map++) {
        const double bottom = v->region_bottom[map * cells + cell], top = v->region_top[map * cells + cell];
        size_t place = count;
        if (bottom > top)
            continue;
        for (; place > 0 && found[place - 1].bottom > bottom; place--)
            found[place] = found[place - 1];
        found[place] = (Interval){bottom, nextafter(top, INFINITY)}; /* the top itself belongs to the region */
        count++;
    }
    for (size_t k = 0; k < count; k++) {
        if (joined == 0 || found[k].bottom > found[joined - 1].top)
            found[joined++] = found[k];
        else
            found[joined - 1].top = fmax(found[joined - 1].top, found[k].top);
    }
    return joined;
}

/* Puts the intervals of each cell as columns in the scratch memory of the instance, where both materials are printed,
 * each in its place; false if there is no memory. */
static bool add_region(Instance *instance, LayerStep *step) {
    const LayerControllerVariables *v = step->values;
    const size_t cells = (size_t)(*v->nx * *v->ny);
    Interval found[INTERVALS_MAX];
    size_t total = 0;
    if (*v->inks == 1 || !*v->has_region)
        return true;
    for (size_t cell = 0; cell < cells; cell++)
        total += intervals_of(v, cell, found);
    int64_t *offsets = scratch_memory(instance, (cells + 1) * sizeof(int64_t) + 2 * total * sizeof(double));
    if (!offsets)
        return false;
    double *bottoms = (double *)(offsets + cells + 1), *tops = bottoms + total;
    offsets[0] = 0;
    for (size_t cell = 0; cell < cells; cell++) {
        const size_t count = intervals_of(v, cell, found);
        for (size_t k = 0; k < count; k++) {
            bottoms[(size_t)offsets[cell] + k] = found[k].bottom;
            tops[(size_t)offsets[cell] + k] = found[k].top;
        }
        offsets[cell + 1] = offsets[cell] + (int64_t)count;
    }
    step->region_offsets = offsets;
    step->region_bottoms = bottoms;
    step->region_tops = tops;
    return true;
}

/* Makes the complete state after the scan at the inputs. */
static Outcome answer(Instance *instance, LayerStep *step, const void *before, void *after, double began) {
    const unsigned long cells = (unsigned long)cells_of(step);
    const int32_t begun = step_begin(step, before, after);
    if (begun == STEP_NO_MEMORY)
        return refuse(instance, "no memory to estimate %lu cells", cells);
    if (begun == STEP_NO_SCAN)
        return refuse(instance,
                      "scan %ld, the first one, has readings on less than 2 %% of %lu cells; expected a scan of the "
                      "surface to print on: look at the sensor",
                      (long)*step->values->layers_scanned, cells);
    if (begun == STEP_ANSWERED)
        return ACCEPTED;
    const Outcome outcome = check_heights(instance, step, state_estimate(after).height);
    if (outcome != ACCEPTED)
        return outcome;
    if (!add_region(instance, step) || step_plan(step, before, after, began) != CORE_DONE)
        return refuse(instance, "no memory to plan %lu cells", cells);
    return ACCEPTED;
}

static Outcome do_step(Instance *instance, double start_time, double end_time) {
    const LayerControllerVariables v = layer_controller_variables(instance);
    LayerStep step = step_of(&v);
    const double began = stopwatch_seconds();
    const size_t size = kept_size(&step);
    void *kept = kept_memory(instance, size);
    (void)start_time, (void)end_time;
    if (!kept)
        return refuse(instance, "no memory for the plan of %lu cells", (unsigned long)cells_of(&step));
    StateHead *head = kept;
    const int32_t shown = *v.layer_command;
    if (head->estimated == NO_SCAN) /* commands count from the layers that the printer has */
        head->layer_command = *v.layer_command = *v.layers_printed;
    if (!step_is_due(&step, kept))
        return ACCEPTED;
    void *after = malloc(size);
    Outcome outcome = after ? answer(instance, &step, kept, after, began)
                            : refuse(instance, "no memory for a plan of %lu cells", (unsigned long)cells_of(&step));
    if (outcome == ACCEPTED && !keep_values(instance))
        outcome = refuse(instance, "no memory to keep the last plan until the next one is whole");
    if (outcome == ACCEPTED) {
        memcpy(kept, after, size);
        step_outputs(&step, kept);
    } else {
        head->layer_command = *v.layer_command = shown;
    }
    free(after);
    return outcome;
}

const Model LAYER_CONTROLLER = {.table = &LAYER_CONTROLLER_VARIABLES,
                                .check_value = check_value,
                                .calculate = calculate,
                                .initialize = initialize,
                                .do_step = do_step};
