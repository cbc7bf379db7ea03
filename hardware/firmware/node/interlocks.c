#include "interlocks.h"

#include "steps.h"

bool interlocks_line(const Node *node, uint32_t line) {
    return (node->hal->lines(node->hal->context) & line) != 0;
}

static bool is_alive(const Node *node) {
    return node->master_seen && node->now - node->times.master_alive < node->options.limits.alive;
}

static bool is_other_master_alive(const Node *node) {
    return node->other_master_seen && node->now - node->other_master_ms < node->options.limits.alive;
}

bool interlocks_one_master(const Node *node) {
    return is_alive(node) && node->supervised && !is_other_master_alive(node);
}

bool interlocks_enabled(const Node *node, uint8_t enables) {
    return interlocks_one_master(node) && (node->master.enables & enables) == enables;
}

void interlocks_lamp_off(Node *node) {
    node->hal->set_lamp(node->hal->context, false);
    if (node->lamp_driven)
        node->times.lamp_off = node->now;
    node->lamp_driven = false;
}

void interlocks_gate_close(Node *node) {
    node->hal->set_gate(node->hal->context, false);
    if (node->gate_driven)
        node->times.gate_closed = node->now;
    node->gate_driven = false;
}

void interlocks_all_off(Node *node) {
    if (node_has(node, ROLE_CURE))
        interlocks_lamp_off(node);
    if (node_has(node, ROLE_HEAD | ROLE_CURE))
        interlocks_gate_close(node);
    node->hal->halt(node->hal->context);
}

bool interlocks_lamp_on(Node *node) {
    if (node->dry)
        return true;
    if (node->gate_driven || !interlocks_line(node, LINE_GATE_CLOSED) || interlocks_line(node, LINE_GATE_OPEN) ||
        !interlocks_enabled(node, ENABLE_LAMP))
        return false;
    node->hal->set_lamp(node->hal->context, true);
    node->lamp_driven = true;
    node->times.lamp_on = node->now;
    return true;
}

bool interlocks_gate_open(Node *node) {
    if (node->dry)
        return true;
    if (node->lamp_driven || interlocks_line(node, LINE_LAMP_ON) || !interlocks_enabled(node, ENABLE_GATE))
        return false;
    node->hal->set_gate(node->hal->context, true);
    node->gate_driven = true;
    node->times.gate_opened = node->now;
    node->gate_pulses++;
    return true;
}

/* What the step under way needs to be allowed. */
static uint8_t needed(const Node *node) {
    const uint8_t motion = node_has(node, ROLE_STAGE) ? ENABLE_MOTION : 0;
    switch (node->step.kind) {
    case STEP_HOME:
    case STEP_MOVE:
        return ENABLE_MOTION;
    case STEP_PASS:
        return node->dry ? motion : (uint8_t)(motion | ENABLE_GATE);
    case STEP_CURE:
        return node->dry ? 0 : ENABLE_LAMP;
    case STEP_SELF_TEST:
        return node->step.lamp_ms ? ENABLE_LAMP : ENABLE_GATE;
    case STEP_SCAN:
        return motion;
    default:
        return 0;
    }
}

static void off(Node *node, Cause cause) {
    node_de_energise(node, NODE_SAFE, cause);
}

static void fault(Node *node, Cause cause) {
    node_de_energise(node, NODE_FAULT, cause);
}

void interlocks_watch(Node *node) {
    if (node_is_off(node))
        return;
    const NodeLimits *limits = &node->options.limits;
    if (!is_alive(node))
        off(node, CAUSE_MASTER_LOST);
    else if (is_other_master_alive(node))
        off(node, CAUSE_TWO_MASTERS);
    else if (!interlocks_enabled(node, needed(node)))
        off(node, CAUSE_ENABLE_DROPPED);
    else if (node->lamp_driven && (!interlocks_line(node, LINE_GATE_CLOSED) || interlocks_line(node, LINE_GATE_OPEN)))
        fault(node, CAUSE_GATE_NOT_CONFIRMED);
    else if (node->lamp_driven && node->now - node->times.lamp_on >= limits->lamp)
        fault(node, CAUSE_LAMP_TIME);
    else if (steps_is_jetting(node) && !interlocks_line(node, LINE_GATE_OPEN))
        fault(node, CAUSE_GATE_NOT_CONFIRMED);
    else if (node->gate_driven && interlocks_line(node, LINE_LAMP_ON)) /* it would cure the ink in the nozzles */
        fault(node, CAUSE_LAMP_TIME);
    else if (node->step.kind != STEP_NONE && node->now - node->step.began >= node->step.expires_in)
        fault(node, CAUSE_STEP_EXPIRED);
}

static void note_other_master(Node *node) {
    node->other_master_seen = true;
    node->other_master_ms = node->now;
    off(node, CAUSE_TWO_MASTERS);
}

void node_master_alive(Node *node, uint32_t now, const MasterAlive *master) {
    node->now = now;
    if (is_alive(node) && node->master.session != master->session) {
        note_other_master(node);
        return;
    }
    if (!node_is_off(node) && node->master_seen && node->master.session != master->session)
        off(node, CAUSE_MASTER_LOST);
    node->master = *master;
    node->master_seen = true;
    node->times.master_alive = now;
    interlocks_watch(node);
}

void node_supervision(Node *node, uint32_t now, bool trusted) {
    node->now = now;
    node->supervised = trusted;
    if (!trusted && !node_is_off(node))
        off(node, CAUSE_SUPERVISION);
}

void node_stop_request(Node *node, uint32_t now, bool active) {
    node->now = now;
    node->stop_active = active;
    if (active)
        off(node, CAUSE_STOP_REQUEST);
}
