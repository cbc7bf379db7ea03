/* The UDS services of a node and its identifiers (0x22). One identifier per request; numbers big-endian.
 *
 * F186 session: 1 default, 3 extended, which ends 5 s after the last request. Both have the same services.
 *
 * F195 version: text of the firmware.
 *
 * 0100 state: state, cause, roles, flags (1 a person has to confirm clear, 2 stop request, 4 pattern in memory, 8 dry
 * run, 16 map ready, 32 journal damaged, 64 the watchdog caused the last power-up, 128 journal unread), job (4), layer
 * (2), passes of the layer, masks of passes done, unknown, cured, flags of the layer (journal.h), step under way, boots
 * (2), session (2), CRC of the pattern (4), clock (4), gate pulses since power-up (4).
 *
 * 0101 times [ms]: clock, last MasterAlive, last turn to SAFE or FAULT, lamp on, lamp off, gate opened, gate closed (4
 * each).
 *
 * 0102 limits: bytes of packed cells (4); alive, lamp, gate, pass, motion, scan [ms] (4 each); block (2).
 *
 * 0103 map: bytes to upload (4), nx (2), ny (2).
 *
 * 0104 transfer: flags (1 under way, 2 upload), counter of the next block, layer (2), job (4), bytes transferred
 * (4), of (4).
 *
 * 0110 journal: records of 40 bytes, newest first, as many as fit: number (4), kind, step, pass, attempt, job (4),
 * layer (2), boots (2), CRC of the pattern (4), passes, done, unknown, cured, flags (4), clock (4), 0 (4), CRC-32
 * (4). */
#ifndef INKLOOP_SERVICES_H
#define INKLOOP_SERVICES_H

#include <stddef.h>

#include "node_state.h"

enum {
    ID_SESSION = 0xF186,
    ID_VERSION = 0xF195,
    ID_STATE = 0x0100,
    ID_TIMES = 0x0101,
    ID_LIMITS = 0x0102,
    ID_MAP = 0x0103,
    ID_TRANSFER = 0x0104,
    ID_JOURNAL = 0x0110
};

/* Answers a request; returns the length of the answer, 0 for none. `cause`, CAUSE_NONE before, is set if the node has
 * to switch off. */
size_t services_answer(Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room, Cause *cause);

/* Ends an extended session without requests; call at each tick. */
void services_tick(Node *node);

#endif
