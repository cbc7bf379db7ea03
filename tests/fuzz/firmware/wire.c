#include "wire.h"

#include <string.h>

#include "e2e.h"
#include "inkloop.h"
#include "inkloop_protocol.h"
#include "uds.h"

enum { ALIVE_EVERY = 100, TICK = 10, TICKS_MAX = 100 };

static bool is_lost(Wire *wire) {
    return wire->lose > 0 && --wire->lose == 0;
}

static void check_status(Wire *wire, const CanFrame *frame) {
    struct inkloop_head_status_t signals;
    const uint16_t data_id = (uint16_t)(INKLOOP_HEAD_STATUS_DATA_ID + wire->frames.number);
    invariant(e2e_check(frame->data, frame->length, data_id), "a status frame is protected");
    const uint8_t counter = e2e_counter(frame->data);
    invariant(!wire->status_seen || counter == (wire->status_counter + 1) % 15, "its counter counts up");
    wire->status_counter = counter;
    wire->status_seen = true;
    invariant(inkloop_head_status_unpack(&signals, frame->data, frame->length) == 0, "it can be read");
    invariant(signals.state == (uint8_t)wire->node.state && signals.lamp_on == wire->board.lamp &&
                  signals.gate_open == wire->board.gate,
              "and reports the real state");
}

/* Moves the frames of both sides until there are none. */
static void move(Wire *wire) {
    const uint32_t now = wire->board.now, number = wire->frames.number;
    CanFrame frame;
    bool moved = true;
    while (moved) {
        moved = false;
        while (node_frames_next(&wire->frames, now, &frame)) {
            moved = true;
            invariant(!frame.extended && !frame.remote && frame.length == CAN_DATA_MAX, "frames of eight bytes");
            if (frame.id == INKLOOP_HEAD_STATUS_FRAME_ID + number)
                check_status(wire, &frame);
            else if (frame.id != INKLOOP_HEAD_FAULT_FRAME_ID + number)
                invariant(frame.id == wire->tester.options.receive_id, "no other ids");
            if (!is_lost(wire))
                isotp_take(&wire->tester, &frame, now);
        }
        while (isotp_next(&wire->tester, now, &frame)) {
            moved = true;
            if (!is_lost(wire))
                node_frames_take(&wire->frames, &frame, now);
        }
    }
}

void wire_turn(Wire *wire, uint32_t milliseconds) {
    wire->board.now += milliseconds;
    isotp_tick(&wire->tester, wire->board.now);
    node_frames_tick(&wire->frames, wire->board.now);
    fuzz_board_check(&wire->board);
    move(wire);
}

void wire_give(Wire *wire, const CanFrame *frame) {
    node_frames_take(&wire->frames, frame, wire->board.now);
    if (wire->node.master_seen && wire->node.times.master_alive == wire->board.now)
        fuzz_board_master_alive(&wire->board, &wire->node.master);
    node_tick(&wire->node, wire->board.now);
    fuzz_board_check(&wire->board);
}

CanFrame wire_alive_frame(Wire *wire, const MasterAlive *master) {
    const struct inkloop_master_alive_t signals = {.lamp_enable = (master->enables & ENABLE_LAMP) != 0,
                                                   .gate_enable = (master->enables & ENABLE_GATE) != 0,
                                                   .motion_enable = (master->enables & ENABLE_MOTION) != 0,
                                                   .session = master->session,
                                                   .job = master->job};
    CanFrame frame = {.id = INKLOOP_MASTER_ALIVE_FRAME_ID, .length = INKLOOP_MASTER_ALIVE_LENGTH};
    inkloop_master_alive_pack(frame.data, &signals, sizeof frame.data);
    e2e_protect(frame.data, frame.length, INKLOOP_MASTER_ALIVE_DATA_ID, wire->counter);
    wire->counter = e2e_next_counter(wire->counter);
    wire->alive_at = wire->board.now;
    return frame;
}

void wire_live(Wire *wire, int ticks) {
    for (int k = 0; k < ticks; k++) {
        if (wire->board.now - wire->alive_at >= ALIVE_EVERY) {
            const CanFrame frame = wire_alive_frame(wire, &wire->master);
            wire_give(wire, &frame);
        }
        wire_turn(wire, TICK);
    }
}

void wire_ask(Wire *wire, const uint8_t *request, size_t length) {
    isotp_abort(&wire->tester);
    if (!isotp_send(&wire->tester, request, length))
        return;
    for (int k = 0; k < TICKS_MAX; k++) {
        size_t answered;
        move(wire);
        wire_live(wire, 1);
        const uint8_t *answer = isotp_received(&wire->tester, &answered);
        if (!answer)
            continue;
        const bool pending = answered == 3 && answer[0] == UDS_NEGATIVE && answer[2] == UDS_PENDING;
        isotp_release(&wire->tester);
        if (!pending)
            return;
    }
}

void wire_power_up(Wire *wire) {
    fuzz_board_power_off(&wire->board);
    wire->board.now += TICK;
    memset(wire->options.pattern_memory, 0xA5, wire->options.pattern_bytes);
    node_init(&wire->node, &wire->options, &wire->board.hal, wire->board.now);
    node_frames_init(&wire->frames, &wire->node, wire->frames.number);
    wire->status_seen = false;
}
