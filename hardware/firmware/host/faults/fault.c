#include "fault.h"

#include "inkloop.h"
#include "random.h"

enum { FIRST_STREAM = 100, STEP_DOWNLOAD = 8 /* first random stream, after those of StepKind */, STEP_UPLOAD };
enum { FIRST_FRAME = 0x1, CONSECUTIVE = 0x2, FLOW_CONTROL = 0x3, FIRST_ISOTP_ID = INKLOOP_HEAD_REQUEST_FRAME_ID };
enum { LAST_ISOTP_ID = INKLOOP_PROFILER_ANSWER_FRAME_ID, POSITIVE = 0x40, NEGATIVE = 0x7F };

static bool fits(int32_t wanted, int32_t found) {
    return wanted == ANY || wanted == found;
}

static bool is_reached(const Fault *fault, const Node *node) {
    const Transfer *transfer = &node->transfer;
    if (transfer->active && fault->pass == ANY && fits(fault->layer, transfer->layer) &&
        fits(fault->step, transfer->upload ? STEP_UPLOAD : STEP_DOWNLOAD))
        return true;
    const Step *step = &node->step;
    return step->kind != STEP_NONE && fits(fault->step, (int32_t)step->kind) && fits(fault->layer, step->key.layer) &&
           fits(fault->pass, step->key.pass);
}

void faults_arm(Faults *faults, Bench *bench) {
    for (uint32_t k = 0; k < faults->count; k++)
        for (int node = 0; node < bench_node_count(bench) && !faults->fault[k].armed; node++)
            faults->fault[k].armed = is_reached(&faults->fault[k], &bench->node[node]);
}

/* Counts an event that matches; returns whether it is hit, or one of the `in_a_row` before it was. */
static bool is_hit(Fault *fault, uint32_t id, uint32_t in_a_row) {
    const int32_t place = (int32_t)(fault->seen[id % STANDARD_IDS]++ & INT32_MAX);
    fault->fitting++;
    bool begins = !fault->over && fault->fitting >= fault->nth;
    if (fault->probability > 0.0)
        begins = random_uniform(fault->seed, (Stream)(FIRST_STREAM + fault->number), id, place) < fault->probability;
    if (begins && fault->left == 0) {
        fault->left = in_a_row;
        fault->over = true;
    }
    if (fault->left == 0)
        return false;
    fault->left--;
    fault->hits++;
    return true;
}

/* Kind of an ISO-TP frame; ANY for other frames. */
static int32_t isotp_kind(const CanFrame *frame) {
    const bool is_isotp = frame->id >= FIRST_ISOTP_ID && frame->id <= LAST_ISOTP_ID && frame->length > 0;
    return is_isotp ? frame->data[0] >> 4 : ANY;
}

static bool is_supervised(uint32_t id) {
    return id == INKLOOP_STOP_REQUEST_FRAME_ID || id == INKLOOP_MASTER_ALIVE_FRAME_ID ||
           (id >= INKLOOP_HEAD_STATUS_FRAME_ID && id <= INKLOOP_PROFILER_STATUS_FRAME_ID);
}

/* Node of a frame, either way; ANY for frames of no single node. */
static int32_t node_of(uint32_t id) {
    if (id >= FIRST_ISOTP_ID && id <= LAST_ISOTP_ID)
        return (int32_t)((id - FIRST_ISOTP_ID) / 2);
    const bool own = (id >= INKLOOP_HEAD_STATUS_FRAME_ID && id <= INKLOOP_PROFILER_STATUS_FRAME_ID) ||
                     (id >= INKLOOP_HEAD_MEASUREMENT_FRAME_ID && id <= INKLOOP_PROFILER_MEASUREMENT_FRAME_ID) ||
                     (id >= INKLOOP_HEAD_FAULT_FRAME_ID && id <= INKLOOP_PROFILER_FAULT_FRAME_ID);
    return own ? (int32_t)(id & 0xF) - 1 : ANY;
}

/* Whether a frame comes when the queue of its node is full: the node empties it once in a block. */
static bool overflows(Fault *fault, Way way, const CanFrame *frame) {
    const int32_t kind = isotp_kind(frame);
    if (kind == ANY)
        return false;
    uint32_t *in_block = &fault->in_block[node_of(frame->id)];
    if (kind == (way == TO_NODES ? FIRST_FRAME : FLOW_CONTROL))
        *in_block = 0;
    return way == TO_NODES && kind == CONSECUTIVE && ++*in_block > fault->frames;
}

/* Whether a fault of this kind can hit the frame. */
static bool is_suitable(Fault *fault, Way way, const CanFrame *frame) {
    switch (fault->kind) {
    case FAULT_FLOW_CONTROL:
        return isotp_kind(frame) == FLOW_CONTROL;
    case FAULT_TRANSMIT_ORDER:
        return way == FROM_NODES;
    case FAULT_SHORT_QUEUE:
        return overflows(fault, way, frame);
    case FAULT_STUCK_COUNTER:
    case FAULT_BAD_CHECK:
        return is_supervised(frame->id);
    default:
        return fault->kind < FAULT_STUCK_COUNTER;
    }
}

bool fault_hits_frame(Fault *fault, Way way, const CanFrame *frame) {
    if (!fault->armed || !fits(fault->way, (int32_t)way) || !fits(fault->id, (int32_t)frame->id))
        return false;
    if (fault->node != ANY && fault->node != node_of(frame->id))
        return false;
    return is_suitable(fault, way, frame) && is_hit(fault, frame->id, fault->count);
}

bool fault_hits_answer(Fault *fault, int node, const uint8_t *answer, size_t length) {
    const int32_t service = length < 2 ? ANY : answer[0] == NEGATIVE ? answer[1] : answer[0] - POSITIVE;
    return fault->armed && fits(fault->node, node) && fits(fault->service, service) &&
           is_hit(fault, (uint32_t)node, fault->count);
}

bool fault_happens(Fault *fault, const CanFrame *frame) {
    const bool at_once = fault->nth == 0 && fault->probability <= 0.0;
    if (!fault->armed || fault->kind < FAULT_REBOOT || at_once != !frame)
        return false;
    if (frame && !fits(fault->id, (int32_t)frame->id))
        return false;
    return is_hit(fault, frame ? frame->id : 0, 1);
}
