#include "interlocks.h"

bool interlocks_line(const Node *node, uint32_t line) {
    return (node->hal->lines(node->hal->context) & line) != 0;
}

bool interlocks_gate_is_closed(const Node *node) {
    return interlocks_line(node, LINE_GATE_CLOSED) && !interlocks_line(node, LINE_GATE_OPEN);
}

bool interlocks_gate_is_open(const Node *node) {
    return interlocks_line(node, LINE_GATE_OPEN) && !interlocks_line(node, LINE_GATE_CLOSED);
}

void interlocks_advance(Node *node, uint32_t now) {
    const uint32_t limit = node->options.limits.alive;
    node->now = now;
    node->master_alive = node->master_alive && now - node->times.master_alive < limit;
    node->other_master_alive = node->other_master_alive && now - node->other_master_ms < limit;
}

bool interlocks_one_master(const Node *node) {
    return node->master_alive && node->supervised && !node->other_master_alive;
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
    if (node->gate_driven || !interlocks_gate_is_closed(node) || !interlocks_enabled(node, ENABLE_LAMP))
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

/* Enable bits that the step under way needs. */
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
        return node->step.option ? ENABLE_LAMP : ENABLE_GATE;
    case STEP_SCAN:
        return motion;
    default:
        return 0;
    }
}

/* Whether droplets are being jetted: the gate must be open. */
static bool is_jetting(const Node *node) {
    return node->step.kind == STEP_PASS && node->step.phase == STEP_WORKING && !node->dry;
}

Cause interlocks_watch(const Node *node) {
    if (node_is_off(node))
        return CAUSE_NONE;
    if (!node->master_alive)
        return CAUSE_MASTER_LOST;
    if (node->other_master_alive)
        return CAUSE_TWO_MASTERS;
    if (!interlocks_enabled(node, needed(node)))
        return CAUSE_ENABLE_DROPPED;
    if (node->lamp_driven && !interlocks_gate_is_closed(node))
        return CAUSE_GATE_NOT_CONFIRMED;
    if (node->lamp_driven && node->now - node->times.lamp_on >= node->options.limits.lamp)
        return CAUSE_LAMP_TIME;
    if (is_jetting(node) && !interlocks_gate_is_open(node))
        return CAUSE_GATE_NOT_CONFIRMED;
    if (node->gate_driven && interlocks_line(node, LINE_LAMP_ON)) /* the lamp would cure the ink in the nozzles */
        return CAUSE_LAMP_TIME;
    if (node->step.kind != STEP_NONE && node->now - node->step.began >= node->step.expires_in)
        return CAUSE_STEP_EXPIRED;
    return CAUSE_NONE;
}

Cause interlocks_take_master(Node *node, const MasterAlive *master) {
    const bool other = node->master.session != master->session;
    if (node->master_alive && other) {
        node->other_master_alive = true;
        node->other_master_ms = node->now;
        node->other_session = master->session;
        return CAUSE_TWO_MASTERS;
    }
    const bool lost = !node_is_off(node) && node->master_seen && other;
    if (node->other_session == master->session) /* the second master has become the accepted one */
        node->other_master_alive = false;
    node->master = *master;
    node->master_seen = node->master_alive = true;
    node->times.master_alive = node->now;
    return lost ? CAUSE_MASTER_LOST : interlocks_watch(node);
}
