/* The parameters of the model as options of the estimator and the planner. */
#ifndef INKLOOP_CONTROLLER_OPTIONS_H
#define INKLOOP_CONTROLLER_OPTIONS_H

#include "layer_problem.h"
#include "passes.h"
#include "layer_controller_variables.h"

Passes passes_of(const LayerControllerVariables *v);
/* Layers that are planned ahead. */
int32_t horizon_of(const LayerControllerVariables *v);

InkPrior nominal_inks(const LayerControllerVariables *v);

EstimatorOptions estimator_options(const LayerControllerVariables *v);

/* regions: the columns of `region_columns`. */
PlannerOptions planner_options(const LayerControllerVariables *v, InkRegions regions);

#endif
