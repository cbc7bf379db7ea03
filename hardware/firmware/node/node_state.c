#include "node_state.h"

bool node_has(const Node *node, uint8_t role) {
    return (node->options.roles & role) != 0;
}

bool node_is_off(const Node *node) {
    return node->state == NODE_SAFE || node->state == NODE_FAULT;
}

Cause node_record(Node *node, RecordKind kind, StepKind step, const Key *key) {
    if (node->dry)
        return CAUSE_NONE;
    Record record = {.kind = kind, .step = step, .progress = node->progress, .time_ms = node->now};
    if (key) {
        record.pass = key->pass;
        record.attempt = key->attempt;
    }
    if (node->journal.unread)
        return CAUSE_JOURNAL_UNREADABLE;
    return journal_append(&node->journal, record) ? CAUSE_NONE : CAUSE_JOURNAL_DAMAGED;
}
