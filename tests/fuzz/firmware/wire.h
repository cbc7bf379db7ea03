/* A node on a bus, with a master's end of ISO-TP, and the invariants of the frames that the node sends. */
#ifndef INKLOOP_FUZZ_WIRE_H
#define INKLOOP_FUZZ_WIRE_H

#include "board.h"
#include "input.h"
#include "node_frames.h"

typedef struct {
    FuzzBoard board;
    Node node;
    NodeFrames frames;
    NodeOptions options;
    Input input;
    Isotp tester; /* the master's end */
    MasterAlive master;
    uint8_t counter, status_counter;
    bool status_seen;
    uint32_t alive_at;
    uint8_t lose; /* so many frames go through, then one is lost; 0: none */
} Wire;

/* One tick after so many ms, the frames of both sides; checks all invariants. */
void wire_turn(Wire *wire, uint32_t milliseconds);

/* Gives the node a frame; the board gets the MasterAlive that the node accepts. */
void wire_give(Wire *wire, const CanFrame *frame);

/* The next heartbeat. */
CanFrame wire_alive_frame(Wire *wire, const MasterAlive *master);

/* Normal operation: a tick every 10 ms, a living master. */
void wire_live(Wire *wire, int ticks);

/* Sends a request and lives until its answer is there or nothing comes. */
void wire_ask(Wire *wire, const uint8_t *request, size_t length);

void wire_power_up(Wire *wire);

#endif
