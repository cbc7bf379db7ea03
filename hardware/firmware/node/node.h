/* Interface of one node of the bench to its caller.
 *
 * Lamp, gate and motion are off in SAFE and FAULT, which is where every node wakes up. All memory is the caller's; time
 * is passed in, in ms, and may wrap. The core does one thing at a time and returns at once. It sends no frames: in each
 * turn of its loop the caller
 *
 *     node_master_alive, node_stop_request, node_request    for what has arrived
 *     node_tick(&node, now)                                 to continue the step under way
 *     node_take_answer(&node, bytes, room)                  and node_status for what is to be sent
 *
 * These are supervised messages and a stop request. They replace neither an emergency stop nor a lamp interlock. */
#ifndef INKLOOP_NODE_H
#define INKLOOP_NODE_H

#include <stddef.h>

#include "node_state.h"

extern const NodeLimits NODE_LIMITS; /* 300 ms alive; the others assumed */

/* Power-up: reads the journal; SAFE, everything off. `options` is copied, `hal` and the pattern memory are kept. */
void node_init(Node *node, const NodeOptions *options, const Hal *hal, uint32_t now);

/* Checks the interlocks and continues the step under way; call at least every 10 ms. The only function that kicks the
 * watchdog: if the node finds itself well. */
void node_tick(Node *node, uint32_t now);

/* A MasterAlive that passed its end-to-end check. */
void node_master_alive(Node *node, uint32_t now, const MasterAlive *master);

/* Whether the end-to-end monitor trusts the frames of MasterAlive (2 of 5 rule). */
void node_supervision(Node *node, uint32_t now, bool trusted);

/* A StopRequest that passed its check: latched until it is released and a person clears the node. */
void node_stop_request(Node *node, uint32_t now, bool active);

/* Answers a UDS request; the length of the answer, 0 for none. `room` >= ANSWER_ROOM: blocks of a map and of the
 * journal are cut to it. */
size_t node_request(Node *node, uint32_t now, const uint8_t *request, size_t length, uint8_t *answer, size_t room);

/* An answer that became ready later; its length, 0 for none. */
size_t node_take_answer(Node *node, uint8_t *answer, size_t room);

/* Contents of a status frame. */
typedef struct {
    NodeState state;
    Cause cause;
    uint16_t layer, boots;
    uint8_t done, unknown;
    bool lamp_on, gate_open, gate_closed, ready;
} NodeStatus;

NodeStatus node_status(const Node *node);

#endif
