/* The wire of the emulator without a bench: frames go in, what comes out is written down. */
#include <string.h>

#include "fault_text.h"
#include "node_faults.h"
#include "wire_faults.h"

enum { TAKEN = 4096 };

typedef struct {
    uint32_t id;
    uint8_t length, data[CAN_DATA_MAX];
    uint8_t is_line, line_length;
    char line[80];
} Taken;

static Faults faults;
static WireFaults wire;
static Taken taken[TAKEN];
static int count;

static void take_frame(void *context, Way way, const CanFrame *frame) {
    (void)context, (void)way;
    if (count == TAKEN)
        return;
    Taken *next = &taken[count++];
    memset(next, 0, sizeof *next);
    next->id = frame->id;
    next->length = frame->length;
    memcpy(next->data, frame->data, sizeof next->data);
}

static void take_line(void *context, const char *bytes, size_t length) {
    (void)context;
    if (count == TAKEN)
        return;
    Taken *next = &taken[count++];
    memset(next, 0, sizeof *next);
    next->is_line = 1;
    next->line_length = (uint8_t)length;
    memcpy(next->line, bytes, length);
}

void probe_begin(void) {
    const WireEnds ends = {.frame = take_frame, .line = take_line};
    memset(&faults, 0, sizeof faults);
    wire_faults_init(&wire, &faults, &ends);
    count = 0;
}

int probe_add(const char *text, char *why, int room) {
    return faults_add(&faults, text, why, (size_t)room);
}

void probe_pass(int way, uint32_t id, const uint8_t *data, uint8_t length) {
    CanFrame frame = {.id = id, .length = length};
    memcpy(frame.data, data, length);
    wire_faults_pass(&wire, (Way)way, &frame);
}

void probe_settle(void) {
    wire_faults_settle(&wire);
}

int probe_count(void) {
    return count;
}

const Taken *probe_taken(int k) {
    return &taken[k];
}

/* The defects of a bench after the faults that happen at once. */
uint32_t probe_broken(void) {
    const BenchOptions options = bench_defaults();
    char why[200];
    Bench *bench = bench_create(&options, NULL, why, sizeof why);
    NodeFaults faulty;
    node_faults_init(&faulty, &faults, bench, &(MasterAdapter){0}, NULL);
    node_faults_happen(&faulty, NULL, 0);
    const uint32_t broken = bench->world.broken;
    bench_delete(bench);
    return broken;
}

/* Whether the first fault hits an answer of a node. */
int probe_hits_answer(int node, const uint8_t *answer, int length) {
    return fault_hits_answer(&faults.fault[0], node, answer, (size_t)length);
}

/* Whether the first fault happens with a frame of this id; -1: in a turn without. */
int probe_happens(int id) {
    const CanFrame frame = {.id = (uint32_t)id};
    return fault_happens(&faults.fault[0], id < 0 ? NULL : &frame);
}

/* Whether the first fault is armed by a step of the cure node, or by a transfer: 0 none, 1 download, 2 upload. */
int probe_arms(int step, int layer, int pass, int transfer) {
    static Bench bench;
    Node *node = &bench.node[BENCH_CURE];
    node->step.kind = (StepKind)step;
    node->step.key.layer = node->transfer.layer = (uint16_t)layer;
    node->step.key.pass = (uint8_t)pass;
    node->transfer.active = transfer > 0;
    node->transfer.upload = transfer == 2;
    faults_arm(&faults, &bench);
    return faults.fault[0].armed;
}

/* Frames of one id that find no place at the head before it ticks; after the tick there is room again. */
uint32_t probe_overruns(uint32_t id, uint32_t count) {
    static NodeFrames frames[BENCH_NODES];
    static NodeFaults faulty;
    const BenchOptions options = bench_defaults();
    char why[200];
    Bench *bench = bench_create(&options, NULL, why, sizeof why);
    node_faults_init(&faulty, &faults, bench, &(MasterAdapter){0}, frames);
    node_faults_power_up(&faulty, BENCH_HEAD, 0);
    const CanFrame frame = {.id = id, .length = CAN_DATA_MAX};
    for (uint32_t k = 0; k < count; k++)
        node_faults_take(&faulty, BENCH_HEAD, &frame);
    const uint32_t overruns = faulty.node[BENCH_HEAD].overruns;
    node_faults_tick(&faulty, BENCH_HEAD, 1);
    node_faults_take(&faulty, BENCH_HEAD, &frame);
    const bool again = faulty.node[BENCH_HEAD].overruns == overruns;
    bench_delete(bench);
    return again ? overruns : UINT32_MAX;
}
