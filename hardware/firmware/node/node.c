#include "node.h"

#include <string.h>

#include "interlocks.h"
#include "services.h"
#include "steps.h"
#include "uds.h"

const NodeLimits NODE_LIMITS = {
    .alive = 300, .lamp = 10000, .gate = 500, .pass = 120000, .motion = 30000, .scan = 60000, .pending = 1000};

static void mark_unknown(LayerProgress *progress, StepKind step, uint8_t pass) {
    if (step == STEP_PASS)
        progress->unknown |= (uint8_t)(1u << pass);
    if (step == STEP_CURE)
        progress->flags |= LAYER_CURE_UNKNOWN;
    if (step == STEP_PASS || step == STEP_CURE)
        progress->flags &= (uint8_t)~LAYER_ACKNOWLEDGED;
}

static bool is_open_question(const LayerProgress *progress) {
    return (progress->unknown != 0 || progress->flags & LAYER_CURE_UNKNOWN) && !(progress->flags & LAYER_ACKNOWLEDGED);
}

/* SAFE when the master is missing, ambiguous or asks for a stop, or what was done is not known; FAULT when a device or
 * the journal fails. */
static NodeState state_after(Cause cause) {
    switch (cause) {
    case CAUSE_MASTER_LOST:
    case CAUSE_STOP_REQUEST:
    case CAUSE_ENABLE_DROPPED:
    case CAUSE_TWO_MASTERS:
    case CAUSE_SUPERVISION:
    case CAUSE_JOURNAL_UNREADABLE:
        return NODE_SAFE;
    default:
        return NODE_FAULT;
    }
}

/* Switches everything off; a pass or cure under way is unknown. A FAULT is kept. CAUSE_NONE, or CAUSE_JOURNAL_DAMAGED
 * if the unknown step cannot be recorded. */
static Cause de_energise(Node *node, Cause cause) {
    const NodeState state = state_after(cause);
    interlocks_all_off(node);
    const Step left = node->step;
    if (left.kind != STEP_NONE)
        steps_give_up(node);
    if (!node_is_off(node) || state == NODE_FAULT)
        node->times.safe = node->now;
    if (node->state != NODE_FAULT || state == NODE_FAULT) {
        node->state = state;
        node->cause = cause;
    }
    node->needs_operator |= state == NODE_FAULT || cause == CAUSE_STOP_REQUEST || cause == CAUSE_TWO_MASTERS ||
                            cause == CAUSE_JOURNAL_UNREADABLE;
    node->transfer.active = node->transfer.ended = false;
    node->pattern_loaded = node->scanned = false;
    if (node->dry) {
        node->dry = false;
        node->progress = node->progress_before_dry_run;
    } else if ((left.kind == STEP_PASS || left.kind == STEP_CURE) && !steps_is_done(node, &left)) {
        mark_unknown(&node->progress, left.kind, left.key.pass);
        node->needs_operator = true;
        if (!node->journal.damaged)
            return node_record(node, RECORD_UNKNOWN, left.kind, &left.key);
    }
    return CAUSE_NONE;
}

/* Applies a cause, and nothing else does: every function that hands the node an input ends here. */
static void enforce(Node *node, Cause cause) {
    while (cause != CAUSE_NONE)
        cause = de_energise(node, cause);
}

void node_init(Node *node, const NodeOptions *options, const Hal *hal, uint32_t now) {
    memset(node, 0, sizeof *node);
    node->hal = hal;
    node->options = *options;
    node->now = now;
    node->supervised = true;
    node->session = SESSION_DEFAULT;
    node->pattern.cells = options->pattern_memory;
    node->pattern.capacity = options->pattern_bytes;
    interlocks_all_off(node);
    node->times = (NodeTimes){.safe = now, .lamp_off = now, .gate_closed = now};
    journal_open(&node->journal, hal);
    const Record *newest = &node->journal.newest;
    node->progress = newest->progress;
    if (newest->kind == RECORD_INTENT)
        mark_unknown(&node->progress, newest->step, newest->pass);
    node->progress.boots++;
    node->needs_operator = is_open_question(&node->progress);
    node->cause = node->needs_operator ? CAUSE_PASS_UNKNOWN : CAUSE_NONE;
    enforce(node, node_record(node, options->by_watchdog ? RECORD_WATCHDOG : RECORD_BOOT, STEP_NONE, NULL));
}

/* Whether all actuators that are on belong to a step that is allowed now, and no interlock is broken. */
static bool is_well(const Node *node) {
    const bool energised = node->lamp_driven || node->gate_driven;
    if (node->state > NODE_FAULT || node->step.kind > STEP_SELF_TEST || (node->lamp_driven && node->gate_driven))
        return false;
    if (node->step.kind == STEP_NONE || node_is_off(node))
        return !energised && (node->step.kind == STEP_NONE);
    return interlocks_watch(node) == CAUSE_NONE;
}

void node_tick(Node *node, uint32_t now) {
    interlocks_advance(node, now);
    const Cause cause = interlocks_watch(node);
    enforce(node, cause != CAUSE_NONE ? cause : steps_continue(node));
    services_tick(node);
    if (is_well(node))
        node->hal->kick(node->hal->context);
}

void node_master_alive(Node *node, uint32_t now, const MasterAlive *master) {
    interlocks_advance(node, now);
    enforce(node, interlocks_take_master(node, master));
}

void node_supervision(Node *node, uint32_t now, bool trusted) {
    interlocks_advance(node, now);
    node->supervised = trusted;
    enforce(node, trusted || node_is_off(node) ? CAUSE_NONE : CAUSE_SUPERVISION);
}

void node_stop_request(Node *node, uint32_t now, bool active) {
    interlocks_advance(node, now);
    node->stop_active = active;
    enforce(node, active ? CAUSE_STOP_REQUEST : CAUSE_NONE);
}

size_t node_request(Node *node, uint32_t now, const uint8_t *request, size_t length, uint8_t *answer, size_t room) {
    interlocks_advance(node, now);
    Cause cause = CAUSE_NONE;
    const size_t answered = services_answer(node, request, length, answer, room, &cause);
    const uint8_t waiting = node->answer_length;
    enforce(node, cause);
    node->answer_length = waiting; /* `answer` already refuses the step that was abandoned */
    return answered;
}

size_t node_take_answer(Node *node, uint8_t *answer, size_t room) {
    const size_t length = node->answer_length;
    if (length == 0 || length > room)
        return 0;
    memcpy(answer, node->answer, length);
    node->answer_length = 0;
    return length;
}

NodeStatus node_status(const Node *node) {
    const uint32_t lines = node->hal->lines(node->hal->context);
    return (NodeStatus){.state = node->state,
                        .cause = node->cause,
                        .layer = node->progress.layer,
                        .boots = node->progress.boots,
                        .done = node->progress.done,
                        .unknown = node->progress.unknown,
                        .lamp_on = node->lamp_driven,
                        .gate_open = node->gate_driven,
                        .gate_closed = interlocks_gate_is_closed(node),
                        .ready = (lines & LINE_READY) != 0};
}
