/* A print as a block with scalars only. Events depend on times of the print alone, never on the steps of the importer:
 * each part is stepped exactly when it is due, as often as needed within a step. */
#include "job_file.h"
#include "job_parts.h"
#include "layer_job_variables.h"
#include "resources.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { CONTROLLER_DONE = 2 };
enum { STATUS_IDLE = 0, STATUS_PRINTING = 1, STATUS_DONE = 2, STATUS_UNTRUSTED = 4 };
enum { WAITING, SCANNING, READY, PRINTING, OVER }; /* stage */
static const double ROUNDING = 1e-6;               /* of a period: importers' times carry rounding */
static const double LAYERS_OF_A_STEP = 10000.0;    /* a longer step is more likely an error (assumed) */

/* Progress of the print. due: end of the stage; READY: its begin. periods: passed since the print began. */
typedef struct {
    int32_t stage;
    double began_at, due, periods;
} Course;

/* Publishes the progress; doubts of the controller show until it is done. */
static void publish_course(const LayerJobVariables *v, const Course *course) {
    const bool is_between = course->stage == READY && !*v->start;
    *v->status = course->stage == OVER                    ? STATUS_DONE
                 : *v->untrusted_reasons > 0              ? STATUS_UNTRUSTED
                 : course->stage == WAITING || is_between ? STATUS_IDLE
                                                          : STATUS_PRINTING;
    *v->stage = course->stage;
    *v->began_at = course->began_at;
    *v->due = course->due;
    *v->periods = course->periods;
}

/* Outputs of the parts that the job shows under the same names. */
static const struct {
    PartRole role;
    const char *name;
} SHOWN[] = {{PRINTER, "layers_printed"},     {PROFILER, "layers_scanned"}, {PRINTER, "height_mean"},
             {PRINTER, "droplets_a"},         {PRINTER, "droplets_b"},      {PRINTER, "volume_lost"},
             {CONTROLLER, "objective"},       {CONTROLLER, "volume_scale"}, {CONTROLLER, "dead_cells"},
             {CONTROLLER, "untrusted_cells"}, {CONTROLLER, "capped_cells"}, {CONTROLLER, "untrusted_reasons"},
             {CONTROLLER, "scan_shift_x"},    {CONTROLLER, "scan_shift_y"}, {CONTROLLER, "scan_spot_radius"}};

/* Error of the surface against the target, over the cells of the part; 0 for no cell. */
static void publish_error(const LayerJobVariables *v, const JobParts *parts) {
    const double *height = read_part(parts, PRINTER, "height"), *target = read_part(parts, CONTROLLER, "target_height");
    const bool *part = read_part(parts, CONTROLLER, "mask");
    const size_t cells = (size_t)(*v->nx * *v->ny);
    double sum = 0.0, absolute = 0.0, squares = 0.0, count = 0.0;
    for (size_t cell = 0; cell < cells; cell++) {
        if (part[cell]) {
            sum += target[cell] - height[cell];
            absolute += fabs(target[cell] - height[cell]);
            count += 1.0;
        }
    }
    const double mean = count > 0.0 ? sum / count : 0.0;
    for (size_t cell = 0; cell < cells; cell++) {
        const double apart = target[cell] - height[cell] - mean;
        squares += part[cell] ? apart * apart : 0.0;
    }
    *v->mean_error = mean;
    *v->mae = count > 0.0 ? absolute / count : 0.0;
    *v->std = count > 0.0 ? sqrt(squares / count) : 0.0;
}

static void publish(Instance *job, const LayerJobVariables *v, const JobParts *parts, const Course *course) {
    for (size_t k = 0; k < sizeof SHOWN / sizeof *SHOWN; k++) {
        const size_t own = variable_of(job, SHOWN[k].name);
        memcpy(values_of(job, own), read_part(parts, SHOWN[k].role, SHOWN[k].name),
               value_size(&job->model->table->variables[own]));
    }
    publish_error(v, parts);
    publish_course(v, course);
}

/* Sets an input of a part to an output of another. */
static Outcome connect(Instance *job, const JobParts *parts, PartRole source, PartRole target, const char *name) {
    return set_part(job, parts, target, name, read_part(parts, source, name));
}

static Outcome step_part(Instance *job, const JobParts *parts, PartRole role, double time) {
    Instance *part = parts->part[role];
    return part->model->do_step(part, time, time) == ACCEPTED ? ACCEPTED : refuse_for_part(job, parts, role);
}

/* The profiler takes the last layer, or ends the scan that it has begun. */
static Outcome scan_layer(Instance *job, const LayerJobVariables *v, const JobParts *parts, Course *course,
                          double time) {
    Outcome outcome = connect(job, parts, PRINTER, PROFILER, "height");
    if (outcome == ACCEPTED)
        outcome = connect(job, parts, PRINTER, PROFILER, "layers_printed");
    if (outcome == ACCEPTED)
        outcome = step_part(job, parts, PROFILER, time);
    const int32_t scanned = part_integer(parts, PROFILER, "layers_scanned");
    const bool is_scanned = scanned == part_integer(parts, PRINTER, "layers_printed");
    course->stage = !is_scanned ? SCANNING : scanned >= *v->layers_max ? OVER : READY;
    course->due = is_scanned ? time : time + *v->scan_duration;
    return outcome;
}

/* The printer takes the command at its inputs, or completes the layer that it has begun. */
static Outcome print_layer(Instance *job, const LayerJobVariables *v, const JobParts *parts, Course *course,
                           double time) {
    const Outcome outcome = step_part(job, parts, PRINTER, time);
    if (outcome != ACCEPTED)
        return outcome;
    if (part_integer(parts, PRINTER, "layers_printed") == part_integer(parts, CONTROLLER, "layer_command"))
        return scan_layer(job, v, parts, course, time);
    course->stage = PRINTING;
    course->due = time + *v->layer_duration;
    return ACCEPTED;
}

/* Passes on the parameters that may change between steps. */
static Outcome tune_controller(Instance *job, const LayerJobVariables *v, const JobParts *parts) {
    const Outcome outcome = set_part(job, parts, CONTROLLER, "alpha", v->alpha);
    return outcome == ACCEPTED ? set_part(job, parts, CONTROLLER, "time_limit", v->time_limit) : outcome;
}

/* The controller answers the last scan, and the printer begins the layer. */
static Outcome begin_layer(Instance *job, const LayerJobVariables *v, const JobParts *parts, Course *course,
                           double time) {
    static const char *const SCAN[] = {"measured_height", "valid", "layers_scanned"};
    static const char *const COMMAND[] = {"pattern", "drop_level", "layer_command"};
    Outcome outcome = tune_controller(job, v, parts);
    for (int k = 0; k < 3 && outcome == ACCEPTED; k++)
        outcome = connect(job, parts, PROFILER, CONTROLLER, SCAN[k]);
    if (outcome == ACCEPTED)
        outcome = connect(job, parts, PRINTER, CONTROLLER, "layers_printed");
    if (outcome == ACCEPTED)
        outcome = step_part(job, parts, CONTROLLER, time);
    if (outcome != ACCEPTED)
        return outcome;
    if (*(const int64_t *)read_part(parts, CONTROLLER, "status") == CONTROLLER_DONE) {
        course->stage = OVER;
        return ACCEPTED;
    }
    outcome = set_part(job, parts, PRINTER, "volume_factor", v->volume_factor);
    for (int k = 0; k < 3 && outcome == ACCEPTED; k++)
        outcome = connect(job, parts, CONTROLLER, PRINTER, COMMAND[k]);
    return outcome == ACCEPTED ? print_layer(job, v, parts, course, time) : outcome;
}

/* Periods after which the next layer begins: never two layers in one period, never before the last layer is scanned. */
static double next_period(const LayerJobVariables *v, const Course *course) {
    return fmax(course->periods + 1.0, ceil((course->due - course->began_at) / *v->layer_period - ROUNDING));
}

/* Time of the next event, in a step that begins at `start`. */
static double next_event(const LayerJobVariables *v, const Course *course, double start) {
    switch (course->stage) {
    case WAITING:
        return *v->start ? start : INFINITY;
    case READY:
        return *v->start ? course->began_at + next_period(v, course) * *v->layer_period : INFINITY;
    case SCANNING:
    case PRINTING:
        return course->due;
    default:
        return INFINITY;
    }
}

static Outcome proceed(Instance *job, const LayerJobVariables *v, const JobParts *parts, Course *course, double time) {
    switch (course->stage) {
    case WAITING:
        course->began_at = time;
        return scan_layer(job, v, parts, course, time);
    case READY:
        course->periods = next_period(v, course);
        return begin_layer(job, v, parts, course, time);
    case PRINTING:
        return print_layer(job, v, parts, course, time);
    default:
        return scan_layer(job, v, parts, course, time);
    }
}

static Outcome read_file(Instance *instance) {
    JobParts parts;
    size_t size = 0;
    char message[MESSAGE_SIZE];
    unsigned char *bytes = read_resource(instance->resources, "job.bin", &size, message, sizeof message);
    if (!bytes)
        return refuse(instance, "%s; what the FMU prints is written by inkloop export job", message);
    Outcome outcome = read_job(instance, bytes, size, &parts);
    free(bytes);
    if (outcome == ACCEPTED)
        outcome = keep_parts(instance, &parts);
    close_parts(&parts);
    return outcome;
}

static void calculate(Instance *instance) {
    const LayerJobVariables v = layer_job_variables(instance);
    const Course course = {.stage = WAITING};
    JobParts parts;
    if (open_parts(instance, &parts) != ACCEPTED)
        return;
    for (int role = 0; role < PARTS; role++)
        parts.part[role]->model->calculate(parts.part[role]);
    publish(instance, &v, &parts, &course);
    close_parts(&parts);
}

static Outcome initialize(Instance *instance) {
    const LayerJobVariables v = layer_job_variables(instance);
    const Course course = {.stage = WAITING};
    JobParts parts;
    Outcome outcome = open_parts(instance, &parts);
    if (outcome != ACCEPTED)
        return outcome;
    outcome = set_part(instance, &parts, PRINTER, "layer_duration", v.layer_duration);
    if (outcome == ACCEPTED)
        outcome = set_part(instance, &parts, PROFILER, "scan_duration", v.scan_duration);
    if (outcome == ACCEPTED)
        outcome = tune_controller(instance, &v, &parts);
    for (int role = 0; role < PARTS && outcome == ACCEPTED; role++)
        if (instance_enter_initialization(parts.part[role], *v.time) != ACCEPTED ||
            instance_exit_initialization(parts.part[role]) != ACCEPTED)
            outcome = refuse_for_part(instance, &parts, (PartRole)role);
    if (outcome == ACCEPTED)
        outcome = keep_parts(instance, &parts);
    if (outcome == ACCEPTED)
        publish(instance, &v, &parts, &course);
    close_parts(&parts);
    return outcome;
}

/* Executes all events up to `reached`; if it refuses, nothing has changed. */
static Outcome print_until(Instance *instance, const LayerJobVariables *v, Course *course, double start,
                           double reached) {
    JobParts parts;
    if (!keep_values(instance))
        return refuse(instance, "no memory to keep the print as it is until the step is over");
    Outcome outcome = open_parts(instance, &parts);
    if (outcome != ACCEPTED)
        return outcome;
    for (double time; outcome == ACCEPTED && (time = next_event(v, course, start)) <= reached;)
        outcome = proceed(instance, v, &parts, course, time);
    if (outcome == ACCEPTED)
        outcome = keep_parts(instance, &parts);
    if (outcome == ACCEPTED)
        publish(instance, v, &parts, course);
    close_parts(&parts);
    return outcome;
}

/* Largest number of layers that a step may print. */
static double layers_due(const LayerJobVariables *v, const Course *course, double start, double reached) {
    const double began_at = course->stage == WAITING ? start : course->began_at;
    if (course->stage == OVER || !*v->start)
        return 0.0;
    return fmin((reached - began_at) / *v->layer_period - course->periods, *v->layers_max - *v->layers_printed);
}

static Outcome do_step(Instance *instance, double start, double end) {
    const LayerJobVariables v = layer_job_variables(instance);
    const double reached = end + ROUNDING * *v.layer_period;
    Course course = {*v.stage, *v.began_at, *v.due, *v.periods};
    const double due = layers_due(&v, &course, start, reached);
    Outcome outcome = ACCEPTED;
    if (due > LAYERS_OF_A_STEP)
        return refuse(instance,
                      "the step has %g layers to print, at a layer_period of %g s; expected at most %g: take shorter "
                      "steps, a longer layer_period or a lower layers_max",
                      due, *v.layer_period, LAYERS_OF_A_STEP);
    if (next_event(&v, &course, start) <= reached)
        outcome = print_until(instance, &v, &course, start, reached);
    if (course.stage == READY && !*v.start) /* periods that pass in a pause are not made up for */
        course.periods = fmax(course.periods, floor((reached - course.began_at) / *v.layer_period));
    if (outcome == ACCEPTED)
        publish_course(&v, &course);
    return outcome;
}

const Model LAYER_JOB = {.table = &LAYER_JOB_VARIABLES,
                         .open = read_file,
                         .calculate = calculate,
                         .initialize = initialize,
                         .do_step = do_step};
