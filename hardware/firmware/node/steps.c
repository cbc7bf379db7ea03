#include "steps.h"

#include "interlocks.h"
#include "uds.h"

enum { OPENING, WORKING, CLOSING };

static bool is_journalled(StepKind kind) {
    return kind == STEP_PASS || kind == STEP_CURE || kind == STEP_SCAN;
}

static uint32_t limit_of(const Node *node, StepKind kind, uint16_t option) {
    const NodeLimits *limits = &node->options.limits;
    switch (kind) {
    case STEP_PASS:
        return limits->pass + 2 * limits->gate;
    case STEP_CURE:
        return option + limits->gate; /* the lamp goes out by itself; then it must be seen to be out */
    case STEP_SELF_TEST:
        return option + 2 * limits->gate;
    case STEP_SCAN:
        return limits->scan;
    default:
        return limits->motion;
    }
}

static bool begin_work(Node *node, WorkKind kind, uint8_t station) {
    const Work work = {.kind = kind,
                       .dry = node->dry,
                       .colour = node->step.colour,
                       .station = station,
                       .layer = node->step.key.layer,
                       .pattern = &node->pattern};
    return node->hal->begin(node->hal->context, &work);
}

static void enter(Node *node, uint8_t phase) {
    node->step.phase = phase;
    node->step.phase_began = node->now;
}

static bool energise(Node *node, uint16_t option) {
    switch (node->step.kind) {
    case STEP_HOME:
        return begin_work(node, WORK_HOME, 0);
    case STEP_MOVE:
        return begin_work(node, WORK_MOVE, (uint8_t)option);
    case STEP_PURGE:
        return begin_work(node, WORK_PURGE, 0);
    case STEP_PASS:
        enter(node, OPENING);
        node->state = NODE_PRINTING;
        return interlocks_gate_open(node);
    case STEP_CURE:
        node->state = NODE_CURING;
        return interlocks_lamp_on(node);
    case STEP_SELF_TEST:
        if (option)
            return interlocks_lamp_on(node);
        enter(node, OPENING);
        return interlocks_gate_open(node);
    default:
        node->state = NODE_SCANNING;
        return begin_work(node, WORK_SCAN, 0);
    }
}

static Cause cause_of(StepKind kind) {
    switch (kind) {
    case STEP_HOME:
    case STEP_MOVE:
        return CAUSE_STAGE_POSITION;
    case STEP_CURE:
    case STEP_SELF_TEST:
        return CAUSE_GATE_NOT_CONFIRMED;
    case STEP_SCAN:
        return CAUSE_SCAN_FAILED;
    default:
        return CAUSE_BACK_PRESSURE;
    }
}

/* Cure and scan may be the first a node hears of a layer; what was under way of another one is over. */
static void open_layer(Node *node, StepKind kind, const Key *key) {
    Book *book = &node->book;
    const bool same = book->job == key->job && book->layer == key->layer;
    if (!same)
        *book = (Book){.job = key->job, .layer = key->layer, .boots = book->boots};
    if (!same || kind == STEP_SCAN) /* blocks of a map are of one scan */
        node->scanned = false;
    if (node->transfer.active)
        node->transfer.active = node->transfer.ended = false;
}

bool steps_begin(Node *node, StepKind kind, uint16_t routine, const Key *key, uint16_t option) {
    if (kind == STEP_CURE || kind == STEP_SCAN)
        open_layer(node, kind, key);
    if (is_journalled(kind) && !node_record(node, RECORD_INTENT, kind, key))
        return false;
    node->step = (Step){.kind = kind,
                        .key = *key,
                        .routine = routine,
                        .phase = WORKING,
                        .colour = (uint8_t)option,
                        .lamp_ms = option,
                        .began = node->now,
                        .expires_in = limit_of(node, kind, option),
                        .phase_began = node->now,
                        .said_busy = node->now};
    if (energise(node, option))
        return true;
    node_de_energise(node, NODE_FAULT, cause_of(kind));
    return false;
}

bool steps_is_done(const Node *node, const Step *step) {
    const Book *book = &node->book;
    const uint8_t bit = (uint8_t)(1u << (step->key.pass % PASSES_MAX));
    return step->kind == STEP_PASS ? (book->done & bit) != 0 : step->phase == CLOSING;
}

bool steps_is_jetting(const Node *node) {
    return node->step.kind == STEP_PASS && node->step.phase == WORKING && !node->dry;
}

void steps_give_up(Node *node) {
    node->answer_length = (uint8_t)uds_refusal(node->answer, UDS_ROUTINE_CONTROL, UDS_FAILED);
    node->step.kind = STEP_NONE;
}

static void answer_done(Node *node) {
    node->answer_length =
        (uint8_t)uds_routine_answer(node->answer, UDS_START, node->step.routine, OUTCOME_DONE, &node->step.key);
    if (!is_journalled(node->step.kind)) {
        node->last_routine = node->step.routine;
        node->last_key = node->step.key;
    }
    node->step.kind = STEP_NONE;
}

/* Writes the DONE of what has just ended. */
static bool note_done(Node *node) {
    const Step *step = &node->step;
    Book *book = &node->book;
    const uint8_t bit = (uint8_t)(1u << (step->key.pass % PASSES_MAX));
    if (step->kind == STEP_PASS)
        book->done |= bit;
    if (step->kind == STEP_CURE) {
        book->cured |= node_has(node, ROLE_HEAD) ? (uint8_t)(book->done | book->unknown) : bit;
        book->flags &= (uint8_t)~BOOK_CURE_UNKNOWN;
    }
    return !is_journalled(step->kind) || node_record(node, RECORD_DONE, step->kind, &step->key);
}

static void continue_pass(Node *node, WorkProgress progress) {
    const bool expired = node->now - node->step.phase_began >= node->options.limits.gate;
    if (node->step.phase == OPENING) {
        if (node->dry || interlocks_line(node, LINE_GATE_OPEN)) {
            enter(node, WORKING);
            if (!begin_work(node, WORK_JET, 0))
                node_de_energise(node, NODE_FAULT, CAUSE_BACK_PRESSURE);
        } else if (expired) {
            node_de_energise(node, NODE_FAULT, CAUSE_GATE_NOT_CONFIRMED);
        }
    } else if (node->step.phase == WORKING && progress == WORK_FINISHED) {
        interlocks_gate_close(node);
        enter(node, CLOSING);
        note_done(node);
    } else if (node->step.phase == CLOSING) {
        if (node->dry || interlocks_line(node, LINE_GATE_CLOSED)) {
            node->state = NODE_PRINTED;
            answer_done(node);
        } else if (expired) {
            node_de_energise(node, NODE_FAULT, CAUSE_GATE_NOT_CONFIRMED);
        }
    }
}

static void continue_cure(Node *node) {
    if (node->step.phase == WORKING && node->now - node->step.phase_began >= node->step.lamp_ms) {
        interlocks_lamp_off(node);
        enter(node, CLOSING);
        note_done(node);
    } else if (node->step.phase == CLOSING && (node->dry || !interlocks_line(node, LINE_LAMP_ON))) {
        node->state = NODE_CURED;
        answer_done(node);
    }
}

/* The gate to its one end and back, or the lamp for a moment: nothing is jetted, and no layer knows of it. */
static void continue_self_test(Node *node) {
    const uint32_t lasted = node->now - node->step.phase_began;
    const bool expired = lasted >= node->options.limits.gate;
    if (node->step.phase == OPENING && interlocks_line(node, LINE_GATE_OPEN)) {
        interlocks_gate_close(node);
        enter(node, CLOSING);
    } else if (node->step.phase == WORKING && lasted >= node->step.lamp_ms) {
        const bool lit = interlocks_line(node, LINE_LAMP_ON);
        interlocks_lamp_off(node);
        enter(node, CLOSING);
        if (!lit)
            node_de_energise(node, NODE_FAULT, CAUSE_LAMP_TIME);
    } else if (node->step.phase == CLOSING && interlocks_line(node, LINE_GATE_CLOSED) &&
               !interlocks_line(node, LINE_LAMP_ON)) {
        answer_done(node);
    } else if (node->step.phase != WORKING && expired) {
        node_de_energise(node, NODE_FAULT, node->step.lamp_ms ? CAUSE_LAMP_TIME : CAUSE_GATE_NOT_CONFIRMED);
    }
}

static void continue_work(Node *node, WorkProgress progress) {
    if (progress != WORK_FINISHED || !note_done(node))
        return;
    if (node->step.kind == STEP_SCAN) {
        node->scanned = true;
        node->scan_attempt = node->step.key.attempt;
        node->state = NODE_MAP_READY;
    }
    answer_done(node);
}

void steps_continue(Node *node) {
    if (node->step.kind == STEP_NONE)
        return;
    const bool working =
        node->step.phase == WORKING && node->step.kind != STEP_CURE && node->step.kind != STEP_SELF_TEST;
    const WorkProgress progress = working ? node->hal->progress(node->hal->context) : WORK_RUNNING;
    if (progress == WORK_FAILED)
        node_de_energise(node, NODE_FAULT, cause_of(node->step.kind));
    else if (node->step.kind == STEP_PASS)
        continue_pass(node, progress);
    else if (node->step.kind == STEP_CURE)
        continue_cure(node);
    else if (node->step.kind == STEP_SELF_TEST)
        continue_self_test(node);
    else
        continue_work(node, progress);
    if (node->step.kind != STEP_NONE && node->now - node->step.said_busy >= node->options.limits.pending) {
        node->answer_length = (uint8_t)uds_refusal(node->answer, UDS_ROUTINE_CONTROL, UDS_PENDING);
        node->step.said_busy = node->now;
    }
}
