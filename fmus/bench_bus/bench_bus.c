/* The four nodes of the bench on one bus. Time passes in turns of 1 ms, whatever the steps of the importer; frames come
 * and go at its communication points, in Event Mode. */
#include "bench_bus_variables.h"
#include "bus_operations.h"
#include "emulation.h"
#include "events.h"
#include "fault_text.h"
#include "parameter_file.h"
#include "resources.h"
#include "values.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BIT_RATE = 500000 };
static const double TURNS_OF_A_STEP = 600000.0; /* ten minutes; a longer step is more likely an error (assumed) */
static const double TURNS_PER_SECOND = 1000.0;
static const double ROUNDING = 1e-6; /* of a turn: importers' times carry rounding */

/* State: the emulation, and behind it the bench; without any pointer between two calls. */
typedef struct {
    Emulation emulation;
    double alignment; /* of the bench */
} Kept;

typedef struct {
    BenchBusVariables v;
    Kept *kept;
} Run;

static Bench *bench_of(Kept *kept) {
    return (Bench *)(kept + 1);
}

static double number_of(Instance *instance, size_t variable) {
    return as_double(BENCH_BUS_VARIABLES.variables[variable].type, values_of(instance, variable));
}

static bool is_option(const VariableDefinition *definition) {
    return (definition->causality == STRUCTURAL || definition->causality == PARAMETER) &&
           definition->shape == ONE_VALUE && definition->type != TYPE_STRING;
}

/* The options of the bench from the variables of their names. */
static Outcome options_of(Instance *instance, BenchOptions *options) {
    *options = bench_defaults();
    for (size_t k = 0; k < BENCH_BUS_VARIABLES.exposed_count; k++) {
        const VariableDefinition *definition = &BENCH_BUS_VARIABLES.variables[k];
        const double value = number_of(instance, k);
        if (is_option(definition) && !bench_set(options, definition->name, value))
            return refuse(instance, "%s is %g; the nodes of the bench do not take it", definition->name, value);
    }
    const char *fault = bench_fault(options);
    return fault ? refuse(instance, "%s", fault) : ACCEPTED;
}

/* Adds the faults of the text. */
static Outcome read_faults(Instance *instance, const char *text, Faults *faults) {
    char one[128], why[200];
    for (text += strspn(text, "; "); *text; text += strspn(text, "; ")) {
        const size_t length = strcspn(text, ";");
        if (length >= sizeof one)
            return refuse(instance, "faults: %.100s... is too long", text);
        memcpy(one, text, length);
        one[length] = '\0';
        text += length;
        if (!faults_add(faults, one, why, sizeof why))
            return refuse(instance, "faults: %s: %s", one, why);
        const Fault *fault = &faults->fault[faults->count - 1];
        if (fault->kind == FAULT_MALFORMED_LINE || fault->kind == FAULT_UNPLUGGED ||
            (fault->kind == FAULT_BUS_OFF && fault->node == ANY))
            return refuse(instance, "faults: %s is a fault of an adapter, and there is none", one);
    }
    return ACCEPTED;
}

/* The FMU of a scenario has its start values in a file. */
static Outcome read_file(Instance *instance) {
    char message[400];
    size_t size = 0;
    ParameterSection own;
    if (instance->is_resizable || *instance->mark == '\0')
        return ACCEPTED;
    unsigned char *bytes = read_resource(instance->resources, "bench.bin", &size, message, sizeof message);
    ParameterFile from = {"bench.bin", "inkloop export bench", bytes, size};
    if (!bytes)
        return refuse(instance, "%s; inkloop export bench writes it", message);
    Outcome outcome = check_head(instance, &from);
    if (outcome == ACCEPTED)
        outcome = check_end(instance, &from, take_section(&from, &own));
    if (outcome == ACCEPTED)
        outcome = check_section(instance, &own, instance->model, "bench");
    if (outcome == ACCEPTED)
        outcome = read_parameters(instance, instance, &own);
    free(bytes);
    return outcome;
}

static Outcome reserve(Instance *instance) {
    BenchOptions options = bench_defaults();
    const double nx = number_of(instance, NX), ny = number_of(instance, NY);
    const char *fault = "the nodes hold at most 65535 cells along an axis";
    if (bench_set(&options, "nx", nx) && bench_set(&options, "ny", ny))
        fault = bench_fault(&options);
    if (!fault && !kept_memory(instance, sizeof(Kept) + bench_size(&options)))
        fault = "there is no memory for them";
    return fault ? refuse(instance, "%g x %g cells: %s", nx, ny, fault) : ACCEPTED;
}

/* A text of faults must be readable before it is taken. */
static Outcome check_value(Instance *instance, size_t variable, const void *value) {
    if (variable != BENCH_BUS_FAULTS)
        return ACCEPTED;
    Faults *faults = scratch_memory(instance, sizeof *faults);
    if (!faults)
        return refuse(instance, "no memory to read faults");
    memset(faults, 0, sizeof *faults);
    return read_faults(instance, value, faults);
}

static size_t room_in(const ByteString *sent) {
    return (size_t)BENCH_BUS_VARIABLES.variables[BENCH_BUS_TX_DATA].max - sent->size;
}

/* Adds a frame of the nodes to what is sent. */
static void send(void *context, const CanFrame *frame) {
    const BenchBusVariables *v = &((Run *)context)->v;
    ByteString *data = v->Tx_Data;
    const size_t written = bus_write_frame(frame, data->bytes + data->size, room_in(data));
    data->size += (uint32_t)written;
    *(written > 0 ? v->frames_sent : v->frames_lost) += 1;
}

static EmulationBus bus_of(Run *run) {
    return (EmulationBus){.context = run, .frame = send, .line = NULL};
}

/* The bench at work; `emulation_unlink` makes it bytes without pointers again. */
static Emulation *wake(Run *run, Instance *instance) {
    *run = (Run){.v = bench_bus_variables(instance)};
    run->kept = (Kept *)instance->kept;
    const EmulationBus bus = bus_of(run);
    emulation_link(&run->kept->emulation, bench_of(run->kept), &bus);
    return &run->kept->emulation;
}

static void publish(const Run *run) {
    const BenchBusVariables *v = &run->v;
    const World *world = &bench_of(run->kept)->world;
    if (*v->droplets != (int32_t)world->droplets)
        memcpy(v->surface_height, world->height, (size_t)(*v->nx * *v->ny) * sizeof *v->surface_height);
    *v->droplets = (int32_t)world->droplets;
    *v->scans = world->scans;
    *v->lamp_on = world->lamp_driven;
    *v->gate_open = world->gate_driven;
    *v->lamp_with_gate = (int32_t)world->lamp_with_gate;
    *v->Tx_Clock = v->Tx_Data->size > 0;
}

static void calculate(Instance *instance) {
    const BenchBusVariables v = bench_bus_variables(instance);
    memcpy(v.surface_height, v.height_start, (size_t)(*v.nx * *v.ny) * sizeof *v.surface_height);
}

static Outcome initialize(Instance *instance) {
    BenchOptions options;
    Outcome outcome = options_of(instance, &options);
    if (outcome != ACCEPTED)
        return outcome;
    Run run = {.v = bench_bus_variables(instance), .kept = (Kept *)instance->kept};
    memset(run.kept, 0, sizeof(Kept) + bench_size(&options));
    Emulation *emulation = &run.kept->emulation;
    outcome = read_faults(instance, (const char *)run.v.faults->bytes, &emulation->faults);
    if (outcome != ACCEPTED)
        return outcome;
    Bench *bench = bench_init(bench_of(run.kept), &options);
    memcpy(bench->world.height, run.v.height_start, (size_t)(*run.v.nx * *run.v.ny) * sizeof(double));
    const EmulationBus bus = bus_of(&run);
    emulation_begin(emulation, bench, &bus, &(MasterAdapter){NULL, NULL, NULL}, 0);
    calculate(instance);
    *run.v.start_time = *run.v.time;
    run.v.Tx_Data->size = (uint32_t)bus_write_configuration(BIT_RATE, run.v.Tx_Data->bytes);
    publish(&run);
    emulation_unlink(emulation);
    return ACCEPTED;
}

static Outcome do_step(Instance *instance, double start, double end) {
    const BenchBusVariables v = bench_bus_variables(instance);
    const double turns = floor((end - *v.start_time) * TURNS_PER_SECOND + ROUNDING);
    (void)start;
    if (turns - *v.turns > TURNS_OF_A_STEP)
        return refuse(instance, "the step has %g turns of 1 ms; expected at most %g: take shorter steps",
                      turns - *v.turns, TURNS_OF_A_STEP);
    if (turns <= *v.turns)
        return ACCEPTED;
    Run run;
    Emulation *emulation = wake(&run, instance);
    while (*v.turns < turns) {
        *v.turns += 1.0;
        emulation_turn(emulation, (uint32_t)(uint64_t)*v.turns);
    }
    publish(&run);
    emulation_unlink(emulation);
    return ACCEPTED;
}

static void take(const Run *run, Emulation *emulation, const BusOperation *operation) {
    const BenchBusVariables *v = &run->v;
    ByteString *sent = v->Tx_Data;
    switch (operation->kind) {
    case BUS_FRAME:
        *v->frames_received += 1;
        emulation_take(emulation, &operation->frame);
        break;
    case BUS_FRAME_LOST:
        *v->frames_lost += 1;
        break;
    case BUS_MALFORMED:
        sent->size += (uint32_t)bus_write_format_error(operation, sent->bytes + sent->size, room_in(sent));
        /* fall through */
    case BUS_NOT_READ:
        *v->format_errors += 1;
        break;
    case BUS_NOTICE:
        break;
    }
}

static Outcome update(Instance *instance) {
    Run run;
    Emulation *emulation = wake(&run, instance);
    ByteString *received = values_of(instance, BENCH_BUS_RX_DATA);
    BusOperations from = {received->bytes, *run.v.Rx_Clock ? received->size : 0};
    BusOperation operation;
    if (*run.v.Tx_Clock)
        write_bytes(instance, BENCH_BUS_TX_DATA, NULL, 0);
    while (bus_operations_next(&from, &operation))
        take(&run, emulation, &operation);
    write_bytes(instance, BENCH_BUS_RX_DATA, NULL, 0);
    publish(&run);
    emulation_unlink(emulation);
    return ACCEPTED;
}

const Model BENCH_BUS = {.table = &BENCH_BUS_VARIABLES,
                         .open = read_file,
                         .reserve = reserve,
                         .check_value = check_value,
                         .calculate = calculate,
                         .initialize = initialize,
                         .do_step = do_step,
                         .update = update};
