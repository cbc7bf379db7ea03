#include "node_faults.h"

#include <string.h>

#include "e2e.h"
#include "inkloop.h"
#include "inkloop_protocol.h"

enum { SHORTENED_BY = 7, MAP_BLOCK_HEAD = 2, UPLOADED = 0x76, OTHER_SESSION = 0x5555 };
enum { GATE_BOTH = BROKEN_GATE_STAYS_OPEN | BROKEN_GATE_STAYS_CLOSED };

void node_faults_init(NodeFaults *faulty, Faults *faults, Bench *bench, Hub *hub, NodeFrames *frames) {
    memset(faulty, 0, sizeof *faulty);
    faulty->faults = faults;
    faulty->bench = bench;
    faulty->hub = hub;
    faulty->frames = frames;
}

void node_faults_power_up(NodeFaults *faulty, int node, uint32_t now) {
    faulty->node[node] = (FaultyNode){.dead = false};
    bench_power_up(faulty->bench, node, now);
    node_frames_init(&faulty->frames[node], bench_node(faulty->bench, node), (uint8_t)node);
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
    case FAULT_BROKEN:
        bench_world(faulty->bench)->broken |= fault->part == END_SWITCHES ? GATE_BOTH : 1u << fault->part;
        break;
    case FAULT_SECOND_MASTER:
        faulty->intrusions = fault->count;
        break;
    case FAULT_UNPLUGGED:
        hub_unplug(faulty->hub, faulty->master_adapter, fault->count - 1);
        break;
    default:
        hub_bus_off(faulty->hub, faulty->master_adapter, fault->count);
    }
}

static void revive(NodeFaults *faulty, uint32_t now) {
    for (int node = 0; node < bench_node_count(faulty->bench); node++) {
        FaultyNode *one = &faulty->node[node];
        if (one->dead && one->revives_after > 0 && --one->revives_after == 0)
            node_faults_power_up(faulty, node, now);
    }
}

void node_faults_happen(NodeFaults *faulty, const CanFrame *frame, uint32_t now) {
    if (frame && frame->id == INKLOOP_MASTER_ALIVE_FRAME_ID) {
        faulty->master_adapter = faulty->hub->sender;
        revive(faulty, now);
    }
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

void node_faults_tick(NodeFaults *faulty, int node, uint32_t now) {
    FaultyNode *one = &faulty->node[node];
    NodeFrames *frames = &faulty->frames[node];
    if (one->kept_length > 0 && !one->is_late && isotp_send(&frames->link, one->kept, one->kept_length))
        one->kept_length = 0;
    const bool was_sending = isotp_is_sending(&frames->link);
    node_frames_tick(frames, now);
    if (was_sending || !isotp_is_sending(&frames->link))
        return;
    if (one->is_late) {
        let_late_one_go(one, &frames->link);
        return;
    }
    Fault *fault = fault_of_answer(faulty, node);
    if (fault)
        spoil(faulty, node, fault);
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
