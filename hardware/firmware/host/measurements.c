#include "measurements.h"

#include "inkloop.h"

static const uint32_t CYCLE[BENCH_NODES] = {200, 200, 500, 1000}; /* ms, GenMsgCycleTime in inkloop.dbc */
static const double HEAD_DEGC = 40.0, BACK_PRESSURE_PA = -800.0, LAMP_DEGC = 30.0, SENSOR_DEGC = 25.0, LAMP_W_M2 = 1e4;

static int write_head(const World *world, CanFrame *frame) {
    const struct inkloop_head_measurement_t signals = {
        .head_temperature = inkloop_head_measurement_head_temperature_encode(HEAD_DEGC),
        .back_pressure = inkloop_head_measurement_back_pressure_encode(BACK_PRESSURE_PA),
        .droplets = (uint32_t)(world->droplets & UINT32_MAX)};
    return inkloop_head_measurement_pack(frame->data, &signals, sizeof frame->data);
}

static int write_stage(CanFrame *frame) {
    const struct inkloop_stage_measurement_t signals = {0}; /* positions between stations are not modelled */
    return inkloop_stage_measurement_pack(frame->data, &signals, sizeof frame->data);
}

static int write_lamp(const World *world, const Node *node, uint32_t now, CanFrame *frame) {
    const NodeTimes *times = &node->times;
    const struct inkloop_cure_measurement_t signals = {
        .irradiance = inkloop_cure_measurement_irradiance_encode(world->lamp_driven ? LAMP_W_M2 : 0.0),
        .lamp_temperature = inkloop_cure_measurement_lamp_temperature_encode(LAMP_DEGC),
        .lamp_time = world->lamp_pulses == 0 ? 0 : (world->lamp_driven ? now : times->lamp_off) - times->lamp_on};
    return inkloop_cure_measurement_pack(frame->data, &signals, sizeof frame->data);
}

static double valid_share(const World *world) {
    const size_t cells = (size_t)world->options.nx * world->options.ny;
    size_t valid = 0;
    for (size_t cell = 0; cell < cells; cell++)
        valid += world->valid[cell] ? 1 : 0;
    return 100.0 * (double)valid / (double)cells;
}

static int write_profiler(const World *world, const Node *node, CanFrame *frame) {
    const bool scanning = node->state == NODE_SCANNING;
    const struct inkloop_profiler_measurement_t signals = {
        .profiler_temperature = inkloop_profiler_measurement_profiler_temperature_encode(SENSOR_DEGC),
        .scan_progress = inkloop_profiler_measurement_scan_progress_encode(scanning || world->scans == 0 ? 0.0 : 100.0),
        .valid_share = inkloop_profiler_measurement_valid_share_encode(valid_share(world)),
        .scans = (uint16_t)((uint32_t)world->scans & UINT16_MAX)};
    return inkloop_profiler_measurement_pack(frame->data, &signals, sizeof frame->data);
}

bool measurements_next(Measurements *measurements, Bench *bench, int node, uint32_t now, CanFrame *frame) {
    if (measurements->begun[node] && now - measurements->sent[node] < CYCLE[node])
        return false;
    measurements->begun[node] = true;
    measurements->sent[node] = now;
    *frame = (CanFrame){.id = (uint32_t)(INKLOOP_HEAD_MEASUREMENT_FRAME_ID + (uint32_t)node)};
    const World *world = &bench->world;
    int length;
    if (node == BENCH_HEAD)
        length = write_head(world, frame);
    else if (node == BENCH_STAGE)
        length = write_stage(frame);
    else if (node == BENCH_CURE)
        length = write_lamp(world, &bench->node[node], now, frame);
    else
        length = write_profiler(world, &bench->node[node], frame);
    frame->length = (uint8_t)length;
    return length > 0;
}
