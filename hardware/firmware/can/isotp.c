#include <string.h>

#include "isotp.h"

/* First byte of a frame: its kind in the high half (ISO 15765-2, table 9). */
enum { SINGLE = 0x0, FIRST = 0x1, CONSECUTIVE = 0x2, FLOW = 0x3 };
enum { FIRST_BYTES = 6, FRAME_BYTES = 7, FLOW_LENGTH = 3, SEPARATION_RESERVED = 127 };

static uint16_t smaller(uint16_t a, uint16_t b) {
    return a < b ? a : b;
}

/* STmin of the wire in whole ms; values below a millisecond are one, reserved values are the longest. */
static uint8_t separation_in_ms(uint8_t on_wire) {
    if (on_wire <= SEPARATION_RESERVED)
        return on_wire;
    return on_wire >= 0xF1 && on_wire <= 0xF9 ? 1 : SEPARATION_RESERVED;
}

static void end_sending(Isotp *end, IsotpEnd how) {
    end->sending.state = ISOTP_SEND_IDLE;
    end->sending.end = how;
    if (how == ISOTP_DONE)
        end->count.sent++;
}

static void end_receiving(Isotp *end, IsotpEnd how) {
    end->receiving.state = how == ISOTP_DONE ? ISOTP_RECEIVE_HELD : ISOTP_RECEIVE_IDLE;
    end->receiving.end = how;
    end->receiving.flow = ISOTP_FLOW_NONE; /* a sender that did not wait needs no flow control any more */
    if (how == ISOTP_DONE)
        end->count.received++;
}

/* Makes room for the beginning message; false while the last one is held. */
static bool may_begin(Isotp *end) {
    if (end->receiving.state == ISOTP_RECEIVE_HELD) {
        end->count.dropped++;
        return false;
    }
    if (end->receiving.state == ISOTP_RECEIVE_FRAMES)
        end->count.replaced++;
    return true;
}

static void take_single(Isotp *end, const CanFrame *frame) {
    const uint8_t length = frame->data[0] & 0xF;
    if (length == 0 || length > FRAME_BYTES || frame->length < 1 + length) {
        end->count.malformed++;
        return;
    }
    if (!may_begin(end))
        return;
    memcpy(end->receiving.bytes, frame->data + 1, length);
    end->receiving.length = length;
    end_receiving(end, ISOTP_DONE);
}

static void take_first(Isotp *end, const CanFrame *frame, uint32_t now) {
    const uint16_t length = (uint16_t)((frame->data[0] & 0xF) << 8 | frame->data[1]);
    const bool escape = length == 0; /* a 32-bit length follows: more than this receiver supports */
    if (frame->length != CAN_DATA_MAX || (!escape && length <= FRAME_BYTES)) {
        end->count.malformed++;
        return;
    }
    if (!may_begin(end)) {
        end->receiving.flow = ISOTP_FLOW_OVERFLOW;
        return;
    }
    if (escape) {
        end_receiving(end, ISOTP_OVERFLOW);
        end->receiving.flow = ISOTP_FLOW_OVERFLOW;
        return;
    }
    memcpy(end->receiving.bytes, frame->data + 2, FIRST_BYTES);
    end->receiving.length = length;
    end->receiving.position = FIRST_BYTES;
    end->receiving.sequence = 1;
    end->receiving.block = end->options.block_size;
    end->receiving.flow = ISOTP_FLOW_GO;
    end->receiving.since = now;
    end->receiving.end = ISOTP_NONE;
    end->receiving.state = ISOTP_RECEIVE_FRAMES;
}

static void take_consecutive(Isotp *end, const CanFrame *frame, uint32_t now) {
    if (end->receiving.state != ISOTP_RECEIVE_FRAMES) {
        end->count.unexpected++;
        return;
    }
    const uint16_t left = (uint16_t)(end->receiving.length - end->receiving.position);
    const uint16_t bytes = smaller(left, FRAME_BYTES);
    if (frame->length < 1 + bytes) {
        end->count.malformed++;
        return;
    }
    if ((frame->data[0] & 0xF) != end->receiving.sequence) {
        end_receiving(end, ISOTP_SEQUENCE);
        return;
    }
    memcpy(end->receiving.bytes + end->receiving.position, frame->data + 1, bytes);
    end->receiving.position = (uint16_t)(end->receiving.position + bytes);
    end->receiving.sequence = (end->receiving.sequence + 1) & 0xF;
    end->receiving.since = now;
    if (bytes == left) {
        end_receiving(end, ISOTP_DONE);
    } else if (end->options.block_size && --end->receiving.block == 0) {
        end->receiving.block = end->options.block_size;
        end->receiving.flow = ISOTP_FLOW_GO;
    }
}

static void take_flow(Isotp *end, const CanFrame *frame, uint32_t now) {
    if (frame->length < FLOW_LENGTH) {
        end->count.malformed++;
        return;
    }
    if (end->sending.state != ISOTP_SEND_FLOW) {
        end->count.unexpected++;
        return;
    }
    switch (frame->data[0] & 0xF) {
    case ISOTP_FLOW_GO:
        end->sending.block = end->sending.block_size = frame->data[1];
        end->sending.separation_ms = separation_in_ms(frame->data[2]);
        end->sending.spaced = false;
        end->sending.waits = 0;
        end->sending.state = ISOTP_SEND_FRAMES;
        break;
    case ISOTP_FLOW_WAIT:
        end->sending.since = now;
        if (end->sending.waits++ >= end->options.wait_max)
            end_sending(end, ISOTP_WAITS);
        break;
    case ISOTP_FLOW_OVERFLOW:
        end_sending(end, ISOTP_OVERFLOW);
        break;
    default:
        end_sending(end, ISOTP_FLOW);
    }
}

bool isotp_take(Isotp *end, const CanFrame *frame, uint32_t now) {
    if (frame->id != end->options.receive_id || frame->extended || frame->remote)
        return false;
    isotp_tick(end, now); /* a late frame is dropped */
    switch (frame->length ? frame->data[0] >> 4 : -1) {
    case SINGLE:
        take_single(end, frame);
        break;
    case FIRST:
        take_first(end, frame, now);
        break;
    case CONSECUTIVE:
        take_consecutive(end, frame, now);
        break;
    case FLOW:
        take_flow(end, frame, now);
        break;
    default:
        end->count.malformed++;
    }
    return true;
}

void isotp_tick(Isotp *end, uint32_t now) {
    if (end->sending.state == ISOTP_SEND_FLOW && now - end->sending.since >= end->options.flow_timeout)
        end_sending(end, ISOTP_TIMEOUT);
    if (end->receiving.state == ISOTP_RECEIVE_FRAMES && end->receiving.flow == ISOTP_FLOW_NONE &&
        now - end->receiving.since >= end->options.frame_timeout)
        end_receiving(end, ISOTP_TIMEOUT);
}

static void begin_frame(const Isotp *end, CanFrame *frame) {
    memset(frame, 0, sizeof *frame);
    frame->id = end->options.send_id;
    frame->length = CAN_DATA_MAX;
    memset(frame->data, end->options.padding, CAN_DATA_MAX);
}

static void next_flow(Isotp *end, uint32_t now, CanFrame *frame) {
    frame->data[0] = (uint8_t)(FLOW << 4 | end->receiving.flow);
    frame->data[1] = end->options.block_size;
    frame->data[2] = end->options.separation;
    end->receiving.flow = ISOTP_FLOW_NONE;
    end->receiving.since = now;
}

static void next_start(Isotp *end, uint32_t now, CanFrame *frame) {
    const uint16_t length = end->sending.length;
    if (length <= FRAME_BYTES) {
        frame->data[0] = (uint8_t)length;
        memcpy(frame->data + 1, end->sending.bytes, length);
        end_sending(end, ISOTP_DONE);
        return;
    }
    frame->data[0] = (uint8_t)(FIRST << 4 | length >> 8);
    frame->data[1] = (uint8_t)(length & 0xFF);
    memcpy(frame->data + 2, end->sending.bytes, FIRST_BYTES);
    end->sending.position = FIRST_BYTES;
    end->sending.sequence = 1;
    end->sending.waits = 0;
    end->sending.since = now;
    end->sending.state = ISOTP_SEND_FLOW;
}

static void next_consecutive(Isotp *end, uint32_t now, CanFrame *frame) {
    const uint16_t left = (uint16_t)(end->sending.length - end->sending.position);
    const uint16_t bytes = smaller(left, FRAME_BYTES);
    frame->data[0] = (uint8_t)(CONSECUTIVE << 4 | end->sending.sequence);
    memcpy(frame->data + 1, end->sending.bytes + end->sending.position, bytes);
    end->sending.position = (uint16_t)(end->sending.position + bytes);
    end->sending.sequence = (end->sending.sequence + 1) & 0xF;
    end->sending.since = now;
    end->sending.spaced = true;
    if (bytes == left)
        end_sending(end, ISOTP_DONE);
    else if (end->sending.block_size && --end->sending.block == 0)
        end->sending.state = ISOTP_SEND_FLOW;
}

/* Whether STmin has passed: a clock of whole ms must show one more than the gap. */
static bool may_follow(const Isotp *end, uint32_t now) {
    return !end->sending.spaced || end->sending.separation_ms == 0 ||
           now - end->sending.since > end->sending.separation_ms;
}

bool isotp_next(Isotp *end, uint32_t now, CanFrame *frame) {
    begin_frame(end, frame);
    if (end->receiving.flow != ISOTP_FLOW_NONE) {
        next_flow(end, now, frame);
        return true;
    }
    if (end->sending.state == ISOTP_SEND_START) {
        next_start(end, now, frame);
        return true;
    }
    if (end->sending.state == ISOTP_SEND_FRAMES && may_follow(end, now)) {
        next_consecutive(end, now, frame);
        return true;
    }
    return false;
}

bool isotp_send(Isotp *end, const uint8_t *bytes, size_t length) {
    if (end->sending.state != ISOTP_SEND_IDLE || length == 0 || length > ISOTP_LENGTH_MAX)
        return false;
    memcpy(end->sending.bytes, bytes, length);
    end->sending.length = (uint16_t)length;
    end->sending.end = ISOTP_NONE;
    end->sending.state = ISOTP_SEND_START;
    return true;
}

bool isotp_is_sending(const Isotp *end) {
    return end->sending.state != ISOTP_SEND_IDLE;
}

const uint8_t *isotp_received(const Isotp *end, size_t *length) {
    *length = end->receiving.state == ISOTP_RECEIVE_HELD ? end->receiving.length : 0;
    return *length ? end->receiving.bytes : NULL;
}

void isotp_release(Isotp *end) {
    if (end->receiving.state == ISOTP_RECEIVE_HELD)
        end->receiving.state = ISOTP_RECEIVE_IDLE;
}

void isotp_abort(Isotp *end) {
    end->sending.state = ISOTP_SEND_IDLE;
    end->receiving.state = ISOTP_RECEIVE_IDLE;
    end->sending.end = end->receiving.end = ISOTP_NONE;
    end->receiving.flow = ISOTP_FLOW_NONE;
}

void isotp_init(Isotp *end, const IsotpOptions *options) {
    memset(end, 0, sizeof *end);
    end->options = *options;
    isotp_abort(end);
}
