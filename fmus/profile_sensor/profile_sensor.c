#include "reading.h"
#include "profile_sensor_variables.h"

#include <string.h>

enum { IDLE, BUSY };
enum { NO_LAYER = -1 };
static const double ROUNDING = 1e-6; /* of a duration: importers' times carry rounding */

static size_t cell_count(const ProfileSensorVariables *v) {
    return (size_t)(*v->nx * *v->ny);
}

static void publish_scan(const ProfileSensorVariables *v, const double *surface) {
    const Instrument instrument = {.pitch = *v->pitch,
                                   .noise_std = *v->noise_std,
                                   .noise_correlation = *v->noise_correlation,
                                   .resolution = *v->resolution,
                                   .bias = *v->bias,
                                   .drift_rate = *v->drift_rate,
                                   .tilt_x = *v->tilt_x,
                                   .tilt_y = *v->tilt_y,
                                   .shift_x = *v->shift_x,
                                   .shift_y = *v->shift_y,
                                   .shift_std = *v->shift_std,
                                   .spot_radius = *v->spot_radius,
                                   .slope_bias = *v->slope_bias,
                                   .dropout_slope = *v->dropout_slope,
                                   .dropout_rate = *v->dropout_rate,
                                   .seed = *v->seed};
    read_surface(&instrument, surface, (size_t)*v->nx, (size_t)*v->ny, *v->scans, v->spot, v->lines, v->measured_height,
                 v->valid);
    *v->layers_scanned = *v->captured_layer;
    *v->scans += 1;
    *v->status = IDLE;
}

static void begin_scan(const ProfileSensorVariables *v, double time) {
    *v->captured_layer = *v->layers_printed;
    *v->ready_at = time + *v->scan_duration;
    *v->status = BUSY;
}

static void calculate(Instance *instance) {
    const ProfileSensorVariables v = profile_sensor_variables(instance);
    memset(v.measured_height, 0, cell_count(&v) * sizeof *v.measured_height);
    memset(v.valid, 0, cell_count(&v) * sizeof *v.valid);
    *v.layers_scanned = NO_LAYER;
    *v.status = IDLE;
}

static Outcome initialize(Instance *instance) {
    const ProfileSensorVariables v = profile_sensor_variables(instance);
    calculate(instance);
    *v.captured_layer = NO_LAYER;
    *v.scans = 0;
    return ACCEPTED;
}

static Outcome do_step(Instance *instance, double start, double end) {
    const ProfileSensorVariables v = profile_sensor_variables(instance);
    if (*v.layers_printed < *v.captured_layer)
        return refuse(instance, "layers_printed is %ld, but layer %ld has been scanned already; it can only rise",
                      (long)*v.layers_printed, (long)*v.captured_layer);
    const bool begins = *v.status == IDLE && *v.layers_printed != *v.captured_layer;
    const double ready_at = begins ? start + *v.scan_duration : *v.ready_at;
    const bool ends = (begins || *v.status == BUSY) && end >= ready_at - ROUNDING * *v.scan_duration;
    if (ends && !keep_values(instance))
        return refuse(instance, "no memory to keep the last scan until the next one is whole");
    if (begins)
        begin_scan(&v, start);
    if (begins && !ends)
        memcpy(v.captured, v.height, cell_count(&v) * sizeof *v.height);
    if (ends)
        publish_scan(&v, begins ? v.height : v.captured);
    return ACCEPTED;
}

const Model PROFILE_SENSOR = {
    .table = &PROFILE_SENSOR_VARIABLES, .calculate = calculate, .initialize = initialize, .do_step = do_step};
