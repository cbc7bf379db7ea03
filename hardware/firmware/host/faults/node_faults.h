/* Faults in the nodes of the emulator and in the adapter of its master, not on the wire itself. */
#ifndef INKLOOP_NODE_FAULTS_H
#define INKLOOP_NODE_FAULTS_H

#include "fault.h"
#include "node_frames.h"

/* One node with its end of the bus. */
typedef struct {
    CanFrame waiting[NODE_FRAMES_QUEUE]; /* received since the last tick */
    uint32_t waits, overruns;            /* frames: that wait, that found no place */
    uint32_t erases_for, busy_for;       /* MasterAlive frames: of the next record's erasure, until one ends */
    uint32_t off_bus_for;                /* MasterAlive frames until its controller is back from bus-off */
    bool dead;
    uint32_t revives_after; /* MasterAlive frames until the node revives; 0: never */
    bool is_late;           /* `kept` was held back, and is sent before the next answer; else it is sent again */
    size_t kept_length;
    uint8_t kept[ISOTP_LENGTH_MAX];
} FaultyNode;

/* The adapter of the master, which some faults are of; functions that are NULL do nothing. */
typedef struct {
    void *context;
    void (*unplug)(void *context, uint32_t refusals);
    void (*bus_off)(void *context, uint32_t times);
} MasterAdapter;

typedef struct {
    Faults *faults;
    Bench *bench;
    NodeFrames *frames; /* BENCH_NODES */
    MasterAdapter adapter;
    FaultyNode node[BENCH_NODES];
    uint32_t intrusions;
    uint8_t intruder_counter;
} NodeFaults;

void node_faults_init(NodeFaults *faulty, Faults *faults, Bench *bench, const MasterAdapter *adapter,
                      NodeFrames *frames);

/* Powers up a node: at the start, and after a fault. */
void node_faults_power_up(NodeFaults *faulty, int node, uint32_t now);

/* Executes all events that are due; `frame`: the frame that has just come from an adapter, NULL once per turn. */
void node_faults_happen(NodeFaults *faulty, const CanFrame *frame, uint32_t now);

/* Replaces `node_frames_take`: the frame waits for the next tick, in a queue of NODE_FRAMES_QUEUE. */
void node_faults_take(NodeFaults *faulty, int node, const CanFrame *frame);

/* Replaces `node_frames_tick`, with faulty answers. False: the node sends nothing now, for it is dead, erases its
 * storage or is off the bus. */
bool node_faults_tick(NodeFaults *faulty, int node, uint32_t now);

/* The MasterAlive of a second master that follows `frame`, if any. */
bool node_faults_intrude(NodeFaults *faulty, const CanFrame *frame, CanFrame *other);

#endif
