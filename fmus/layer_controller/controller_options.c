#include "controller_options.h"

#include "layer_surface.h"
#include "region_columns.h"
#include "shortest_plan.h"

#include <math.h>

static const double NO_LIMIT = 1.0; /* [m], of the overshoot: the largest value means none */

Passes passes_of(const LayerControllerVariables *v) {
    return (Passes){*v->passes, *v->pass_order, *v->pass_rotation};
}

int32_t horizon_of(const LayerControllerVariables *v) {
    return *v->horizon == 0 ? finish_of((int32_t)*v->finish).horizon : *v->horizon;
}

InkPrior nominal_inks(const LayerControllerVariables *v) {
    const Ink a = {*v->h1_a, *v->h2_a, *v->h3_a}, b = {*v->h1_b, *v->h2_b, *v->h3_b};
    return (InkPrior){(size_t)*v->inks, {a, *v->inks == 1 ? a : b}, (int32_t)*v->adapt_ink};
}

static double layers_of_all(const Ink ink[], size_t inks) {
    double height = full_layer_height(&ink[0]);
    for (size_t k = 1; k < inks; k++)
        height += full_layer_height(&ink[k]);
    return height;
}

/* Height of a full layer [m]; where there is a region, the mean over its inks. */
static double nominal_layer(const LayerControllerVariables *v) {
    const InkPrior prior = nominal_inks(v);
    const size_t inks = has_region(v) ? prior.inks : 1;
    return layers_of_all(prior.nominal, inks) / (double)inks;
}

EstimatorOptions estimator_options(const LayerControllerVariables *v) {
    const double noise = *v->sensor_noise_std, layer = nominal_layer(v);
    const double steps = *v->sensor_resolution * *v->sensor_resolution / 12.0;
    return (EstimatorOptions){.nx = (size_t)*v->nx,
                              .ny = (size_t)*v->ny,
                              .part = (const uint8_t *)v->mask,
                              .target = v->target_height,
                              .ink = nominal_inks(v),
                              .drop_levels = *v->drop_levels,
                              .flat_ground = *v->flat_ground,
                              .register_scans = *v->register_scans,
                              .unseen_layers = *v->untrusted_layers,
                              .noise_variance = noise < 0.0 ? -1.0 : noise * noise + steps,
                              .steps_variance = steps,
                              .first_variance = layer * layer,
                              .volume_least = *v->volume_least,
                              .volume_most = *v->volume_most};
}

PlannerOptions planner_options(const LayerControllerVariables *v, InkRegions regions) {
    const Finish finish = finish_of((int32_t)*v->finish);
    regions.step = nominal_layer(v);
    regions.test = (int32_t)*v->region_test;
    return (PlannerOptions){.nx = (size_t)*v->nx,
                            .ny = (size_t)*v->ny,
                            .horizon = (size_t)horizon_of(v),
                            .foreign_horizon = (size_t)(*v->horizon == 0 ? finish.foreign_horizon : *v->horizon),
                            .target = v->target_height,
                            .part = (const uint8_t *)v->mask,
                            .jettable = (const uint8_t *)v->jettable,
                            .inks = (size_t)*v->inks,
                            .regions = regions,
                            .drop_levels = *v->drop_levels,
                            .passes = *v->passes,
                            .alpha = *v->alpha,
                            .overshoot = *v->overshoot,
                            .overshoot_limit = *v->overshoot_limit < NO_LIMIT ? *v->overshoot_limit : INFINITY,
                            .chance_margin = *v->chance_margin,
                            .fringe_weight = *v->fringe_weight,
                            .droplet_std = *v->droplet_std,
                            .layer_worth = *v->layer_worth < 0.0 ? finish.layer_worth : *v->layer_worth,
                            .sweeps = *v->sweeps_max,
                            .annealing_sweeps = *v->annealing_sweeps,
                            .iterations = *v->iterations,
                            .seed = (uint32_t)*v->seed,
                            .seconds_max = *v->time_limit > 0.0 ? *v->time_limit : INFINITY};
}
