#include "node_frames.h"

#include <string.h>

#include "e2e.h"
#include "inkloop.h"
#include "inkloop_protocol.h"

enum { STATUS_CYCLE = 100, FAULT_CYCLE = 1000 }; /* ms, GenMsgCycleTime in inkloop.dbc */
enum { RELEASES_NEEDED = 2 };
enum { REQUEST_ID = INKLOOP_HEAD_REQUEST_FRAME_ID, IDS_PER_NODE = 2 };

void node_frames_init(NodeFrames *frames, Node *node, uint8_t number) {
    memset(frames, 0, sizeof *frames);
    frames->node = node;
    frames->number = number;
    const uint32_t request = (uint32_t)(REQUEST_ID + IDS_PER_NODE * number);
    const IsotpOptions options = {.receive_id = request,
                                  .send_id = request + 1,
                                  .block_size = 16,
                                  .padding = 0xCC,
                                  .wait_max = 8,
                                  .flow_timeout = 1000,
                                  .frame_timeout = 1000};
    isotp_init(&frames->link, &options);
    e2e_monitor_init(&frames->monitor);
    e2e_monitor_init(&frames->stop_monitor);
}

static bool is_checked(const CanFrame *frame, size_t length, uint16_t data_id) {
    return frame->length == length && e2e_check(frame->data, length, data_id);
}

/* One intact frame stops. A release needs RELEASES_NEEDED of them in a row with consecutive counters: neither a damaged
 * frame that passes its check by chance, nor a repeated old one, releases a stop. */
static void take_stop_request(NodeFrames *frames, const CanFrame *frame, uint32_t now) {
    const bool checked = is_checked(frame, INKLOOP_STOP_REQUEST_LENGTH, INKLOOP_STOP_REQUEST_DATA_ID);
    const E2eVerdict verdict = e2e_monitor_take(&frames->stop_monitor, checked, e2e_counter(frame->data));
    struct inkloop_stop_request_t signals = {.active = 1};
    if (verdict != E2E_DAMAGED)
        inkloop_stop_request_unpack(&signals, frame->data, frame->length);
    const bool follows = verdict == E2E_GOOD || verdict == E2E_LOST;
    frames->releases = signals.active ? 0 : follows ? (uint8_t)(frames->releases + 1) : 1;
    if (signals.active && verdict != E2E_DAMAGED)
        node_stop_request(frames->node, now, true);
    if (frames->releases >= RELEASES_NEEDED)
        node_stop_request(frames->node, now, false);
}

static MasterAlive master_of(const CanFrame *frame) {
    struct inkloop_master_alive_t signals = {0};
    inkloop_master_alive_unpack(&signals, frame->data, frame->length);
    const int enables = (signals.lamp_enable ? ENABLE_LAMP : 0) | (signals.gate_enable ? ENABLE_GATE : 0) |
                        (signals.motion_enable ? ENABLE_MOTION : 0);
    return (MasterAlive){.enables = (uint8_t)enables, .session = signals.session, .job = signals.job};
}

/* Takes a MasterAlive. Another session is another sender with its own counter: the node gets its frame, and supervision
 * is reset if the node accepts the new master. */
static void take_master_alive(NodeFrames *frames, const CanFrame *frame, uint32_t now) {
    Node *node = frames->node;
    const bool checked = is_checked(frame, INKLOOP_MASTER_ALIVE_LENGTH, INKLOOP_MASTER_ALIVE_DATA_ID);
    const MasterAlive master = checked ? master_of(frame) : node->master;
    const bool other = !node->master_seen || master.session != node->master.session;
    if (checked && other) {
        node_master_alive(node, now, &master);
        if (node->master.session != master.session)
            return;
        e2e_monitor_init(&frames->monitor);
    }
    const E2eVerdict verdict = e2e_monitor_take(&frames->monitor, checked, e2e_counter(frame->data));
    node_supervision(node, now, e2e_monitor_trusts(&frames->monitor));
    if (!other && (verdict == E2E_FIRST || verdict == E2E_GOOD || verdict == E2E_LOST))
        node_master_alive(node, now, &master);
}

bool node_frames_want(const NodeFrames *frames, const CanFrame *frame) {
    return !frame->extended && !frame->remote &&
           (frame->id == INKLOOP_STOP_REQUEST_FRAME_ID || frame->id == INKLOOP_MASTER_ALIVE_FRAME_ID ||
            frame->id == frames->link.options.receive_id);
}

void node_frames_take(NodeFrames *frames, const CanFrame *frame, uint32_t now) {
    if (!node_frames_want(frames, frame))
        return;
    if (frame->id == INKLOOP_STOP_REQUEST_FRAME_ID)
        take_stop_request(frames, frame, now);
    else if (frame->id == INKLOOP_MASTER_ALIVE_FRAME_ID)
        take_master_alive(frames, frame, now);
    else
        isotp_take(&frames->link, frame, now);
}

void node_frames_tick(NodeFrames *frames, uint32_t now) {
    node_tick(frames->node, now);
    isotp_tick(&frames->link, now);
    if (isotp_is_sending(&frames->link))
        return;
    size_t length = node_take_answer(frames->node, frames->answer, sizeof frames->answer);
    if (length == 0) {
        size_t asked;
        const uint8_t *request = isotp_received(&frames->link, &asked);
        if (!request)
            return;
        length = node_request(frames->node, now, request, asked, frames->answer, sizeof frames->answer);
        isotp_release(&frames->link);
    }
    if (length > 0)
        isotp_send(&frames->link, frames->answer, length);
}

/* All four status messages have one layout. */
static void write_status(NodeFrames *frames, CanFrame *frame) {
    const NodeStatus status = node_status(frames->node);
    const struct inkloop_head_status_t signals = {.lamp_on = status.lamp_on,
                                                  .gate_open = status.gate_open,
                                                  .gate_closed = status.gate_closed,
                                                  .ready = status.ready,
                                                  .state = (uint8_t)status.state,
                                                  .pass_mask = status.done,
                                                  .fault = (uint8_t)status.cause,
                                                  .layer = status.layer,
                                                  .boot_count = (uint8_t)(status.boots & 0xFFu),
                                                  .unknown_mask = status.unknown,
                                                  .protocol_version = INKLOOP_PROTOCOL_VERSION};
    *frame = (CanFrame){.id = (uint32_t)(INKLOOP_HEAD_STATUS_FRAME_ID + frames->number),
                        .length = INKLOOP_HEAD_STATUS_LENGTH};
    inkloop_head_status_pack(frame->data, &signals, sizeof frame->data);
    const uint16_t data_id = (uint16_t)(INKLOOP_HEAD_STATUS_DATA_ID + frames->number);
    e2e_protect(frame->data, frame->length, data_id, frames->counter);
    frames->counter = e2e_next_counter(frames->counter);
}

static void write_fault(const NodeFrames *frames, uint32_t now, CanFrame *frame) {
    const Node *node = frames->node;
    const struct inkloop_head_fault_t signals = {.fault = (uint8_t)node->cause,
                                                 .pass = node->journal.newest.pass & 0xFu,
                                                 .layer = node->progress.layer,
                                                 .node_time = node->cause == CAUSE_NONE ? now : node->times.safe};
    *frame =
        (CanFrame){.id = (uint32_t)(INKLOOP_HEAD_FAULT_FRAME_ID + frames->number), .length = INKLOOP_HEAD_FAULT_LENGTH};
    inkloop_head_fault_pack(frame->data, &signals, sizeof frame->data);
}

bool node_frames_next(NodeFrames *frames, uint32_t now, CanFrame *frame) {
    const Cause cause = frames->node->cause;
    if (cause != frames->cause_sent || (cause != CAUSE_NONE && now - frames->fault_at >= FAULT_CYCLE)) {
        write_fault(frames, now, frame);
        frames->cause_sent = cause;
        frames->fault_at = now;
        return true;
    }
    if (!frames->status_sent || now - frames->status_at >= STATUS_CYCLE) {
        write_status(frames, frame);
        frames->status_sent = true;
        frames->status_at = now;
        return true;
    }
    return isotp_next(&frames->link, now, frame);
}
