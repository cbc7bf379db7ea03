/* The wire between adapters and nodes: every frame in either direction passes through every fault in turn. */
#ifndef INKLOOP_WIRE_FAULTS_H
#define INKLOOP_WIRE_FAULTS_H

#include "fault.h"

enum { HELD_FRAMES = 64 };

/* Receivers of frames; `line`: bytes that an adapter writes in place of a frame. */
typedef struct {
    void *context;
    void (*frame)(void *context, Way way, const CanFrame *frame);
    void (*line)(void *context, const char *bytes, size_t length);
} WireEnds;

typedef struct {
    CanFrame frame;
    Way way;
    uint32_t behind; /* frames of its direction that still overtake it; 0: the place is free */
    bool same_id;    /* only frames of its id overtake it, in this turn of its node */
    uint32_t next;   /* index of its next fault */
} HeldFrame;

typedef struct {
    Faults *faults;
    WireEnds ends;
    HeldFrame held[HELD_FRAMES];
    uint8_t counter[STANDARD_IDS]; /* counter of the last supervised frame */
} WireFaults;

void wire_faults_init(WireFaults *wire, Faults *faults, const WireEnds *ends);

/* Takes a frame; it is delivered at once, later, twice, altered, or never. */
void wire_faults_pass(WireFaults *wire, Way way, const CanFrame *frame);

/* Ends the turn of a node: what still waits in its mailboxes leaves. */
void wire_faults_settle(WireFaults *wire);

#endif
