/* The interlocks, which a node enforces for every request: the lamp only with the gate confirmed closed and never
 * longer than its limit, nothing energised without a living master that enables it, and off means off. */
#ifndef INKLOOP_INTERLOCKS_H
#define INKLOOP_INTERLOCKS_H

#include "node_state.h"

/* Sets the clock; a master that has been silent for its limit stays dead, however often the clock wraps. */
void interlocks_advance(Node *node, uint32_t now);

/* Lamp off, gate closed, jets off, stage held. */
void interlocks_all_off(Node *node);

/* Checks all interlocks; CAUSE_NONE, or the first that is broken. Call it first in each tick. */
Cause interlocks_watch(const Node *node);

/* Accepts a MasterAlive, unless another master lives. CAUSE_NONE, or why the node has to go off. */
Cause interlocks_take_master(Node *node, const MasterAlive *master);

/* The only way to switch the lamp on; false, with no effect, unless the gate is confirmed closed. */
bool interlocks_lamp_on(Node *node);
void interlocks_lamp_off(Node *node);

/* The only way to open the gate; false, with no effect, while the lamp is on. */
bool interlocks_gate_open(Node *node);
void interlocks_gate_close(Node *node);

/* Whether the master lives and allows all of `enables`. */
bool interlocks_enabled(const Node *node, uint8_t enables);

/* Whether a wired input is true. */
bool interlocks_line(const Node *node, uint32_t line);

/* Whether one end switch of the gate reports closed and the other one does not contradict it. */
bool interlocks_gate_is_closed(const Node *node);
bool interlocks_gate_is_open(const Node *node);

/* Whether one master lives, and no other. */
bool interlocks_one_master(const Node *node);

#endif
