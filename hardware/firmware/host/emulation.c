#include "emulation.h"

#include <string.h>

enum { FRAMES_AT_ONCE = 64 };

/* Takes a frame behind the wire faults. */
static void deliver(void *context, Way way, const CanFrame *frame) {
    Emulation *emulation = context;
    if (way == FROM_NODES) {
        emulation->bus.frame(emulation->bus.context, frame);
        return;
    }
    for (int node = 0; node < bench_node_count(emulation->bench); node++)
        node_faults_take(&emulation->faulty, node, frame);
}

static void deliver_line(void *context, const char *bytes, size_t length) {
    const EmulationBus *bus = &((Emulation *)context)->bus;
    if (bus->line)
        bus->line(bus->context, bytes, length);
}

static WireEnds wire_ends(Emulation *emulation) {
    return (WireEnds){.context = emulation, .frame = deliver, .line = deliver_line};
}

void emulation_begin(Emulation *emulation, Bench *bench, const EmulationBus *bus, const MasterAdapter *adapter,
                     uint32_t now) {
    const WireEnds ends = wire_ends(emulation);
    emulation->bench = bench;
    emulation->bus = *bus;
    emulation->now = now;
    wire_faults_init(&emulation->wire, &emulation->faults, &ends);
    node_faults_init(&emulation->faulty, &emulation->faults, bench, adapter, emulation->frames);
    for (int node = 0; node < bench_node_count(bench); node++)
        node_faults_power_up(&emulation->faulty, node, now);
}

void emulation_take(Emulation *emulation, const CanFrame *frame) {
    CanFrame other;
    node_faults_happen(&emulation->faulty, frame, emulation->now);
    wire_faults_pass(&emulation->wire, TO_NODES, frame);
    if (node_faults_intrude(&emulation->faulty, frame, &other)) {
        deliver(emulation, TO_NODES, &other);
        deliver(emulation, FROM_NODES, &other);
    }
}

static void run_node(Emulation *emulation, int node) {
    CanFrame frame;
    if (!node_faults_tick(&emulation->faulty, node, emulation->now))
        return;
    for (int sent = 0; sent < FRAMES_AT_ONCE; sent++) {
        if (!node_frames_next(&emulation->frames[node], emulation->now, &frame))
            break;
        wire_faults_pass(&emulation->wire, FROM_NODES, &frame);
    }
    wire_faults_settle(&emulation->wire);
    if (measurements_next(&emulation->measurements, emulation->bench, node, emulation->now, &frame))
        wire_faults_pass(&emulation->wire, FROM_NODES, &frame);
}

void emulation_turn(Emulation *emulation, uint32_t now) {
    Bench *bench = emulation->bench;
    emulation->now = now;
    world_tick(&bench->world, now);
    faults_arm(&emulation->faults, bench);
    node_faults_happen(&emulation->faulty, NULL, now);
    for (int node = 0; node < bench_node_count(bench); node++) {
        if (bench_watchdog_bites(bench, node, now))
            node_faults_power_up(&emulation->faulty, node, now);
        run_node(emulation, node);
    }
}

void emulation_link(Emulation *emulation, Bench *bench, const EmulationBus *bus) {
    NodeFaults *faulty = &emulation->faulty;
    bench_link(bench);
    emulation->bench = faulty->bench = bench;
    emulation->bus = *bus;
    emulation->wire.ends = wire_ends(emulation);
    emulation->wire.faults = faulty->faults = &emulation->faults;
    faulty->frames = emulation->frames;
    for (int node = 0; node < BENCH_NODES; node++)
        emulation->frames[node].node = &bench->node[node];
}

void emulation_unlink(Emulation *emulation) {
    NodeFaults *faulty = &emulation->faulty;
    bench_unlink(emulation->bench);
    memset(&emulation->bus, 0, sizeof emulation->bus);
    memset(&emulation->wire.ends, 0, sizeof emulation->wire.ends);
    emulation->wire.faults = faulty->faults = NULL;
    emulation->bench = faulty->bench = NULL;
    faulty->frames = NULL;
    for (int node = 0; node < BENCH_NODES; node++)
        emulation->frames[node].node = NULL;
}
