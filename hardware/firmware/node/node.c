#include "node.h"

#include <string.h>

#include "interlocks.h"
#include "steps.h"

const NodeLimits NODE_LIMITS = {
    .alive = 300, .lamp = 10000, .gate = 500, .pass = 120000, .motion = 30000, .scan = 60000, .pending = 1000};

static void mark_unknown(Book *book, StepKind step, uint8_t pass) {
    if (step == STEP_PASS)
        book->unknown |= (uint8_t)(1u << pass);
    if (step == STEP_CURE)
        book->flags |= BOOK_CURE_UNKNOWN;
    if (step == STEP_PASS || step == STEP_CURE)
        book->flags &= (uint8_t)~BOOK_ACKNOWLEDGED;
}

static bool is_open_question(const Book *book) {
    return (book->unknown != 0 || book->flags & BOOK_CURE_UNKNOWN) && !(book->flags & BOOK_ACKNOWLEDGED);
}

void node_init(Node *node, const NodeOptions *options, const Hal *hal, uint32_t now) {
    memset(node, 0, sizeof *node);
    node->hal = hal;
    node->options = *options;
    node->now = now;
    node->supervised = true;
    node->pattern.cells = options->pattern_memory;
    node->pattern.capacity = options->pattern_bytes;
    interlocks_all_off(node);
    node->times = (NodeTimes){.safe = now, .lamp_off = now, .gate_closed = now};
    journal_open(&node->journal, hal);
    const Record *newest = &node->journal.newest;
    node->book = newest->book;
    if (newest->kind == RECORD_INTENT)
        mark_unknown(&node->book, newest->step, newest->pass);
    node->book.boots++;
    node->needs_operator = is_open_question(&node->book);
    node->cause = node->needs_operator ? CAUSE_PASS_UNKNOWN : CAUSE_NONE;
    node_record(node, RECORD_BOOT, STEP_NONE, NULL);
}

bool node_has(const Node *node, uint8_t role) {
    return (node->options.roles & role) != 0;
}

bool node_is_off(const Node *node) {
    return node->state == NODE_SAFE || node->state == NODE_FAULT;
}

bool node_record(Node *node, RecordKind kind, StepKind step, const Key *key) {
    if (node->dry)
        return true;
    Record record = {.kind = kind, .step = step, .book = node->book, .time_ms = node->now};
    if (key) {
        record.pass = key->pass;
        record.attempt = key->attempt;
    }
    if (journal_append(&node->journal, record))
        return true;
    node_de_energise(node, NODE_FAULT, CAUSE_JOURNAL_DAMAGED);
    return false;
}

void node_de_energise(Node *node, NodeState state, Cause cause) {
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
    node->needs_operator |= state == NODE_FAULT || cause == CAUSE_STOP_REQUEST || cause == CAUSE_TWO_MASTERS;
    node->transfer.active = node->transfer.ended = false;
    node->pattern_loaded = node->scanned = false;
    if (node->dry) {
        node->dry = false;
        node->book = node->book_before_dry_run;
    } else if ((left.kind == STEP_PASS || left.kind == STEP_CURE) && !steps_is_done(node, &left)) {
        mark_unknown(&node->book, left.kind, left.key.pass);
        node->needs_operator = true;
        if (!node->journal.damaged)
            node_record(node, RECORD_UNKNOWN, left.kind, &left.key);
    }
}

void node_tick(Node *node, uint32_t now) {
    node->now = now;
    interlocks_watch(node);
    steps_continue(node);
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
                        .layer = node->book.layer,
                        .boots = node->book.boots,
                        .done = node->book.done,
                        .unknown = node->book.unknown,
                        .lamp_on = node->lamp_driven,
                        .gate_open = node->gate_driven,
                        .gate_closed = (lines & LINE_GATE_CLOSED) != 0,
                        .ready = (lines & LINE_READY) != 0};
}
