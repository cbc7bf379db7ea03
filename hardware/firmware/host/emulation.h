/* The four nodes of the bench on one bus, with the faults of wire and nodes: what frames of a master do, and what the
 * nodes send, turn by turn. The caller has the bus and the clock. */
#ifndef INKLOOP_EMULATION_H
#define INKLOOP_EMULATION_H

#include "measurements.h"
#include "node_faults.h"
#include "wire_faults.h"

/* The bus: takes the frames of the nodes. `line`: bytes in place of a frame; NULL where there are no lines. */
typedef struct {
    void *context;
    void (*frame)(void *context, const CanFrame *frame);
    void (*line)(void *context, const char *bytes, size_t length);
} EmulationBus;

typedef struct {
    Bench *bench;
    EmulationBus bus;
    NodeFrames frames[BENCH_NODES];
    Measurements measurements;
    Faults faults; /* to be added before the begin */
    WireFaults wire;
    NodeFaults faulty;
    uint32_t now;
} Emulation;

/* Powers up all nodes. */
void emulation_begin(Emulation *emulation, Bench *bench, const EmulationBus *bus, const MasterAdapter *adapter,
                     uint32_t now);

/* A frame of a master, between two turns. */
void emulation_take(Emulation *emulation, const CanFrame *frame);

/* A turn of all nodes, at most 10 ms after the last one. */
void emulation_turn(Emulation *emulation, uint32_t now);

/* Sets every pointer again, and those of the bench; unlinked, there are none: the bytes may be kept or moved. */
void emulation_link(Emulation *emulation, Bench *bench, const EmulationBus *bus);
void emulation_unlink(Emulation *emulation);

#endif
