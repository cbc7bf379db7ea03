/* One node on the bus: the frames it receives and sends. Ids, layouts and cycles are those of
 * inkloop.dbc; node `number` 0 is the head, 1 the stage, 2 the cure lamp, 3 the profiler.
 *
 * A board calls these functions and those of node.h from one loop, none of them from an interrupt: they are not
 * reentrant. Each turn, at most 10 ms after the last one, takes all frames that wait, ticks, and sends what is due.
 *
 * Receive: frames that the node wants wait in a queue of at least NODE_FRAMES_QUEUE; filters of the controller keep out
 * all others. A FIFO of three frames overflows in every block of a transfer, whose 16 frames come without a pause
 * (STmin 0). The other places are for what comes during an erasure of 300 ms: 3 MasterAlive and 6 StopRequest, one more
 * of each on its way, 4 MasterAlive of a second master, a flow control. A frame that is lost costs its message.
 *
 * Transmit: frames of one id leave in the order in which node_frames_next gives them. A controller with several
 * mailboxes sends the oldest first (bxCAN: TXFP), or gets one frame at a time.
 *
 * Bus-off: the loop ticks on, and the node goes off by itself for want of MasterAlive. The board drops the frames that
 * wait to be sent and asks for no others until its controller is back (ISO 11898-1: 128 times 11 recessive bits; by
 * itself or set by the board). It may come back at any time: the node waits to be cleared. */
#ifndef INKLOOP_NODE_FRAMES_H
#define INKLOOP_NODE_FRAMES_H

#include "can_frame.h"
#include "e2e_monitor.h"
#include "isotp.h"
#include "node.h"

enum { NODE_FRAMES_QUEUE = 32 };

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
    uint8_t answer[ISOTP_LENGTH_MAX];
} NodeFrames;

void node_frames_init(NodeFrames *frames, Node *node, uint8_t number);

/* Whether a frame is one that the node takes: the others need no place in its queue. */
bool node_frames_want(const NodeFrames *frames, const CanFrame *frame);

/* Takes a frame from the bus; frames for other nodes are ignored. */
void node_frames_take(NodeFrames *frames, const CanFrame *frame, uint32_t now);

/* Ticks the node and answers its requests. */
void node_frames_tick(NodeFrames *frames, uint32_t now);

/* The next frame that is due; call until there is none, and only with room for one. */
bool node_frames_next(NodeFrames *frames, uint32_t now, CanFrame *frame);

#endif
