#include "node_faults.h"

#include <string.h>

#include "e2e.h"
#include "inkloop.h"
#include "inkloop_protocol.h"

enum { SHORTENED_BY = 7, MAP_BLOCK_HEAD = 2, UPLOADED = 0x76, OTHER_SESSION = 0x5555 };
enum { GATE_BOTH = BROKEN_GATE_STAYS_OPEN | BROKEN_GATE_STAYS_CLOSED };

void node_faults_init(NodeFaults *faulty, Faults *faults, Bench *bench, const MasterAdapter *adapter,
                      NodeFrames *frames) {
    memset(faulty, 0, sizeof *faulty);
    faulty->faults = faults;
    faulty->bench = bench;
    faulty->adapter = *adapter;
    faulty->frames = frames;
}

void node_faults_power_up(NodeFaults *faulty, int node, uint32_t now) {
    faulty->node[node] = (FaultyNode){.dead = false};
    bench_power_up(faulty->bench, node, now);
    node_frames_init(&faulty->frames[node], &faulty->bench->node[node], (uint8_t)node);
}

static void die(NodeFaults *faulty, int node, uint32_t frames) {
    faulty->node[node].dead = true;
    faulty->node[node].revives_after = frames;
    bench_power_off(faulty->bench, node);
}

static void happen(NodeFaults *faulty, const Fault *fault, uint32_t now) {
    switch (fault->kind) {
    case FAULT_REBOOT:
        node_faults_power_up(faulty, fault->node, now);
        break;
    case FAULT_DEATH:
        die(faulty, fault->node, fault->frames);
        break;
    case FAULT_HANG: /* its outputs stay as they are until the watchdog expires */
        faulty->node[fault->node].dead = true;
        break;
    case FAULT_SLOW_ERASE:
        faulty->node[fault->node].erases_for = fault->frames;
        break;
    case FAULT_UNREADABLE:
        bench_decay(faulty->bench, fault->node, fault->count);
        break;
    case FAULT_BROKEN:
        faulty->bench->world.broken |= fault->part == END_SWITCHES ? GATE_BOTH : 1u << fault->part;
        break;
    case FAULT_SECOND_MASTER:
        faulty->intrusions = fault->count;
        break;
    case FAULT_UNPLUGGED:
        if (faulty->adapter.unplug)
            faulty->adapter.unplug(faulty->adapter.context, fault->count - 1);
        break;
    case FAULT_BUS_OFF:
        if (fault->node != ANY)
            faulty->node[fault->node].off_bus_for = fault->frames;
        else if (faulty->adapter.bus_off)
            faulty->adapter.bus_off(faulty->adapter.context, fault->count);
        break;
    default: /* faults of frames and answers */
        break;
    }
}

static bool is_last(uint32_t *frames) {
    return *frames > 0 && --*frames == 0;
}

/* Counts a MasterAlive for nodes that do not hear it. */
static void count_down(NodeFaults *faulty, uint32_t now) {
    for (int node = 0; node < bench_node_count(faulty->bench); node++) {
        FaultyNode *one = &faulty->node[node];
        is_last(&one->busy_for);
        is_last(&one->off_bus_for);
        if (one->dead && is_last(&one->revives_after))
            node_faults_power_up(faulty, node, now);
    }
}

void node_faults_happen(NodeFaults *faulty, const CanFrame *frame, uint32_t now) {
    if (frame && frame->id == INKLOOP_MASTER_ALIVE_FRAME_ID)
        count_down(faulty, now);
    for (uint32_t k = 0; k < faulty->faults->count; k++)
        if (fault_happens(&faulty->faults->fault[k], frame))
            happen(faulty, &faulty->faults->fault[k], now);
}

/* Spoils an answer before its first frame is sent. */
static void spoil(NodeFaults *faulty, int node, Fault *fault) {
    FaultyNode *one = &faulty->node[node];
    Isotp *link = &faulty->frames[node].link;
    const uint16_t length = link->sending.length;
    if (fault->kind == FAULT_SHORT_MAP) {
        const bool shortens = link->sending.bytes[0] == UPLOADED && length > MAP_BLOCK_HEAD + SHORTENED_BY;
        link->sending.length = (uint16_t)(length - (shortens ? SHORTENED_BY : 0));
        return;
    }
    one->is_late = fault->kind == FAULT_LATE_ANSWER;
    one->kept_length = length;
    memcpy(one->kept, link->sending.bytes, length);
    if (one->is_late)
        link->sending.state = ISOTP_SEND_IDLE;
}

/* Sends the late answer first, the new one after it. */
static void let_late_one_go(FaultyNode *one, Isotp *link) {
    uint8_t newer[ISOTP_LENGTH_MAX];
    const uint16_t length = link->sending.length;
    memcpy(newer, link->sending.bytes, length);
    memcpy(link->sending.bytes, one->kept, one->kept_length);
    link->sending.length = (uint16_t)one->kept_length;
    memcpy(one->kept, newer, length);
    one->kept_length = length;
    one->is_late = false;
}

static Fault *fault_of_answer(NodeFaults *faulty, int node) {
    const Isotp *link = &faulty->frames[node].link;
    Fault *found = NULL;
    for (uint32_t k = 0; k < faulty->faults->count; k++) {
        Fault *fault = &faulty->faults->fault[k];
        if (fault->kind < FAULT_LATE_ANSWER || fault->kind > FAULT_SHORT_MAP)
            continue;
        if (fault->kind == FAULT_SHORT_MAP && link->sending.bytes[0] != UPLOADED)
            continue;
        if (fault_hits_answer(fault, node, link->sending.bytes, link->sending.length))
            found = fault;
    }
    return found;
}

void node_faults_take(NodeFaults *faulty, int node, const CanFrame *frame) {
    FaultyNode *one = &faulty->node[node];
    if (one->dead || one->off_bus_for > 0 || !node_frames_want(&faulty->frames[node], frame))
        return;
    if (one->waits == NODE_FRAMES_QUEUE)
        one->overruns++;
    else
        one->waiting[one->waits++] = *frame;
}

/* A turn of the node's loop. */
static void turn(NodeFaults *faulty, int node, uint32_t now) {
    FaultyNode *one = &faulty->node[node];
    const Board *board = &faulty->bench->board[node];
    const uint32_t written = board->writes;
    for (uint32_t k = 0; k < one->waits; k++)
        node_frames_take(&faulty->frames[node], &one->waiting[k], now);
    one->waits = 0;
    node_frames_tick(&faulty->frames[node], now);
    if (board->writes == written)
        return;
    one->busy_for = one->erases_for;
    one->erases_for = 0;
}

bool node_faults_tick(NodeFaults *faulty, int node, uint32_t now) {
    FaultyNode *one = &faulty->node[node];
    Isotp *link = &faulty->frames[node].link;
    if (one->dead || one->busy_for > 0)
        return false;
    if (one->kept_length > 0 && !one->is_late && isotp_send(link, one->kept, one->kept_length))
        one->kept_length = 0;
    const bool was_sending = isotp_is_sending(link);
    turn(faulty, node, now);
    if (!was_sending && isotp_is_sending(link)) {
        Fault *fault = one->is_late ? NULL : fault_of_answer(faulty, node);
        if (one->is_late)
            let_late_one_go(one, link);
        else if (fault)
            spoil(faulty, node, fault);
    }
    return one->off_bus_for == 0 && one->busy_for == 0;
}

bool node_faults_intrude(NodeFaults *faulty, const CanFrame *frame, CanFrame *other) {
    if (frame->id != INKLOOP_MASTER_ALIVE_FRAME_ID || faulty->intrusions == 0)
        return false;
    faulty->intrusions--;
    struct inkloop_master_alive_t signals = {0};
    inkloop_master_alive_unpack(&signals, frame->data, frame->length);
    signals.session ^= OTHER_SESSION;
    *other = *frame;
    inkloop_master_alive_pack(other->data, &signals, sizeof other->data);
    e2e_protect(other->data, other->length, INKLOOP_MASTER_ALIVE_DATA_ID, faulty->intruder_counter);
    faulty->intruder_counter = e2e_next_counter(faulty->intruder_counter);
    return true;
}
