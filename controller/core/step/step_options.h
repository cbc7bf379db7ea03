/* Inputs of a controller, and the options that parts of the core take from them. */
#ifndef INKLOOP_STEP_OPTIONS_H
#define INKLOOP_STEP_OPTIONS_H

#include "ink_regions.h"
#include "layer_controller_values.h"
#include "plan_work.h"
#include "surface_estimate.h"

/* Options, inputs and outputs are the variables of fmus/layer_controller/variables.toml, each where its owner keeps it:
 * an FMU in its block of memory, Python in arrays. The region of the first ink comes as columns (ink_regions.h), NULL:
 * there is none; region_bottom, region_top and region_intervals are its form in an FMU, and are not looked at. */
typedef struct {
    const LayerControllerVariables *values;
    const int64_t *region_offsets;
    const double *region_bottoms, *region_tops;
    int32_t threads;      /* 1 or more; the bits do not depend on it */
    int32_t take_as_read; /* no estimation: heights are the readings */
} LayerStep;

size_t cells_of(const LayerStep *step);

/* Number of layers planned ahead; is_foreign: the model does not describe the plant (surface_estimate.h). */
size_t horizon_of(const LayerStep *step, bool is_foreign);

/* The colour of each pass of layer number `layer`, in the order jetted; unused for one pass. */
void layer_colours(const LayerStep *step, int32_t layer, int32_t colours[4]);

InkPrior nominal_inks(const LayerStep *step);
InkRegions ink_regions(const LayerStep *step);
EstimatorOptions estimator_options(const LayerStep *step);

/* Limits of the work on the plan after layer number `layer`, without start plans. */
PlanWork plan_work(const LayerStep *step, int32_t layer);

#endif
