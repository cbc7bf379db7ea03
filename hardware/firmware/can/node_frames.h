/* One node on the bus: the frames it receives and sends. Ids, layouts and cycles are those of
 * inkloop.dbc; node `number` 0 is the head, 1 the stage, 2 the cure lamp, 3 the profiler. */
#ifndef INKLOOP_NODE_FRAMES_H
#define INKLOOP_NODE_FRAMES_H

#include "can_frame.h"
#include "e2e_monitor.h"
#include "isotp.h"
#include "node.h"

typedef struct {
    Node *node;
    uint8_t number;
    Isotp link;
    E2eMonitor monitor, stop_monitor; /* monitors of MasterAlive and StopRequest */
    uint8_t releases;                 /* intact frames in a row, with consecutive counters, that request a release */
    uint8_t counter;                  /* alive counter of the status frame */
    bool status_sent;
    uint32_t status_at, fault_at; /* time of the last one [ms] */
    Cause cause_sent;
    uint32_t damaged; /* supervised frames whose check byte was wrong */
    uint8_t answer[ISOTP_LENGTH_MAX];
} NodeFrames;

void node_frames_init(NodeFrames *frames, Node *node, uint8_t number);

/* Takes a frame from the bus; frames for other nodes are ignored. */
void node_frames_take(NodeFrames *frames, const CanFrame *frame, uint32_t now);

/* Ticks the node and answers its requests. */
void node_frames_tick(NodeFrames *frames, uint32_t now);

/* The next frame that is due; call until there is none, and only with room for one. */
bool node_frames_next(NodeFrames *frames, uint32_t now, CanFrame *frame);

#endif
