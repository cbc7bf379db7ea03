#include "random.h"
#include "scan.h"
#include "variables.h"

#include <math.h>
#include <string.h>

enum { IDLE, BUSY };
enum { NO_LAYER = -1 };
static const double ROUNDING = 1e-6; /* of a duration: importers' times carry rounding */

static size_t cell_count(const ProfileSensorVariables *v) {
    return (size_t)(*v->nx * *v->ny);
}

static double noise_at(const ProfileSensorVariables *v, size_t cell, double common) {
    if (*v->noise_std == 0.0)
        return 0.0;
    const double white = random_normal(*v->seed, STREAM_WHITE_NOISE, cell, *v->scans);
    return *v->noise_std * (sqrt(*v->noise_correlation) * common + sqrt(1.0 - *v->noise_correlation) * white);
}

static bool is_lost(const ProfileSensorVariables *v, size_t cell, double slope) {
    if (*v->dropout_slope > 0.0 && slope > *v->dropout_slope)
        return true;
    return *v->dropout_rate > 0.0 && random_uniform(*v->seed, STREAM_DROPOUT, cell, *v->scans) < *v->dropout_rate;
}

/* The plane and the offset that a badly set up sensor adds at cell (i, j). */
static double set_up_error(const ProfileSensorVariables *v, size_t i, size_t j) {
    const double x = ((double)i - 0.5 * (double)(*v->nx - 1)) * *v->pitch;
    const double y = ((double)j - 0.5 * (double)(*v->ny - 1)) * *v->pitch;
    return *v->tilt_x * x + *v->tilt_y * y + *v->bias + *v->drift_rate * *v->scans;
}

/* Reading of the captured surface, in the order of the hardware: spot, slope, noise, drop-out, tilt, bias, steps. */
static void publish_scan(const ProfileSensorVariables *v) {
    const size_t nx = (size_t)*v->nx, ny = (size_t)*v->ny;
    average_over_spot(v->captured, v->spot, v->lines, nx, ny, *v->pitch, *v->spot_radius);
    const double common = random_normal(*v->seed, STREAM_COMMON_NOISE, 0, *v->scans);
    for (size_t i = 0; i < nx; i++) {
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            const double slope = slope_at(v->spot, nx, ny, i, j, *v->pitch);
            const double sine_of_double_angle = 2.0 * slope / (1.0 + slope * slope);
            double reading = v->spot[cell] + *v->slope_bias * sine_of_double_angle + noise_at(v, cell, common);
            reading += set_up_error(v, i, j);
            if (*v->resolution > 0.0)
                reading = rint(reading / *v->resolution) * *v->resolution;
            v->valid[cell] = !is_lost(v, cell, slope);
            if (v->valid[cell])
                v->measured_height[cell] = reading;
        }
    }
    *v->layers_scanned = *v->captured_layer;
    *v->scans += 1;
    *v->status = IDLE;
}

static void begin_scan(const ProfileSensorVariables *v, double time) {
    memcpy(v->captured, v->height, cell_count(v) * sizeof *v->height);
    *v->captured_layer = *v->layers_printed;
    *v->ready_at = time + *v->scan_duration;
    *v->status = BUSY;
}

Outcome kernel_check_value(Instance *instance, size_t variable, const void *value) {
    (void)instance, (void)variable, (void)value;
    return ACCEPTED;
}

void kernel_calculate(Instance *instance) {
    const ProfileSensorVariables v = profile_sensor_variables(instance);
    memset(v.measured_height, 0, cell_count(&v) * sizeof *v.measured_height);
    memset(v.valid, 0, cell_count(&v) * sizeof *v.valid);
    *v.layers_scanned = NO_LAYER;
    *v.status = IDLE;
}

Outcome kernel_initialize(Instance *instance) {
    const ProfileSensorVariables v = profile_sensor_variables(instance);
    kernel_calculate(instance);
    *v.captured_layer = NO_LAYER;
    *v.scans = 0;
    return ACCEPTED;
}

Outcome kernel_do_step(Instance *instance, double start, double end) {
    const ProfileSensorVariables v = profile_sensor_variables(instance);
    if (*v.layers_printed < *v.captured_layer)
        return refuse(instance, "layers_printed is %ld, but layer %ld has been scanned already; it can only rise",
                      (long)*v.layers_printed, (long)*v.captured_layer);
    if (*v.status == IDLE && *v.layers_printed != *v.captured_layer)
        begin_scan(&v, start);
    if (*v.status == BUSY && end >= *v.ready_at - ROUNDING * *v.scan_duration)
        publish_scan(&v);
    return ACCEPTED;
}
