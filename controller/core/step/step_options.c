#include "step_options.h"

#include <math.h>

#include "pass_colour.h"
#include "shortest_plan.h"

size_t cells_of(const LayerStep *step) {
    return (size_t)(*step->values->nx * *step->values->ny);
}

size_t horizon_of(const LayerStep *step, bool is_foreign) {
    const LayerControllerVariables *v = step->values;
    const Finish finish = finish_of((int32_t)*v->finish);
    return (size_t)(*v->horizon > 0 ? *v->horizon : is_foreign ? finish.foreign_horizon : finish.horizon);
}

void layer_colours(const LayerStep *step, int32_t layer, int32_t colours[4]) {
    const LayerControllerVariables *v = step->values;
    const Passes passes = {*v->passes, *v->pass_order, *v->pass_rotation};
    for (int pass = 0; pass < COLOURS; pass++)
        colours[pass] = pass_colour(&passes, layer, pass);
}

InkPrior nominal_inks(const LayerStep *step) {
    const LayerControllerVariables *v = step->values;
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
static double nominal_layer(const LayerStep *step) {
    const InkPrior prior = nominal_inks(step);
    const size_t inks = *step->values->has_region ? prior.inks : 1;
    return layers_of_all(prior.nominal, inks) / (double)inks;
}

InkRegions ink_regions(const LayerStep *step) {
    return (InkRegions){.offsets = step->region_offsets,
                        .bottoms = step->region_bottoms,
                        .tops = step->region_tops,
                        .step = nominal_layer(step),
                        .test = (int32_t)*step->values->region_test};
}

EstimatorOptions estimator_options(const LayerStep *step) {
    const LayerControllerVariables *v = step->values;
    const double noise = *v->sensor_noise_std, layer = nominal_layer(step);
    const double steps = *v->sensor_resolution * *v->sensor_resolution / 12.0;
    return (EstimatorOptions){.nx = (size_t)*v->nx,
                              .ny = (size_t)*v->ny,
                              .part = (const uint8_t *)v->mask,
                              .target = v->target_height,
                              .ink = nominal_inks(step),
                              .drop_levels = *v->drop_levels,
                              .flat_ground = *v->flat_ground,
                              .take_as_read = step->take_as_read,
                              .register_scans = *v->register_scans,
                              .unseen_layers = *v->untrusted_layers,
                              .noise_variance = noise < 0.0 ? -1.0 : noise * noise + steps,
                              .steps_variance = steps,
                              .first_variance = layer * layer,
                              .volume_least = *v->volume_least,
                              .volume_most = *v->volume_most};
}

PlanWork plan_work(const LayerStep *step, int32_t layer) {
    const LayerControllerVariables *v = step->values;
    const double layer_worth = *v->layer_worth < 0.0 ? finish_of((int32_t)*v->finish).layer_worth : *v->layer_worth;
    return (PlanWork){.layer_worth = layer_worth,
                      .sweeps = *v->sweeps_max,
                      .annealing_sweeps = *v->annealing_sweeps,
                      .iterations = *v->iterations,
                      .seed = ((uint64_t)(uint32_t)*v->seed << 32) + (uint64_t)layer,
                      .seconds_max = *v->time_limit > 0.0 ? *v->time_limit : INFINITY,
                      .threads = step->threads};
}
