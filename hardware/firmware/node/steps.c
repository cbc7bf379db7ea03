#include "steps.h"

#include "interlocks.h"
#include "uds.h"

static bool is_journalled(StepKind kind) {
    return kind == STEP_PASS || kind == STEP_CURE || kind == STEP_SCAN;
}

static uint32_t limit_of(const Node *node, StepKind kind, uint16_t option) {
    const NodeLimits *limits = &node->options.limits;
    switch (kind) {
    case STEP_PASS:
        return limits->pass + 2 * limits->gate;
    case STEP_CURE:
        return option + limits->gate; /* the lamp switches off at `option`; then its line must show it */
    case STEP_SELF_TEST:
        return option + 2 * limits->gate;
    case STEP_SCAN:
        return limits->scan;
    default:
        return limits->motion;
    }
}

/* The option is the colour of a pass or the station of a move. */
static bool begin_work(Node *node, WorkKind kind) {
    const Work work = {.kind = kind,
                       .dry = node->dry,
                       .colour = kind == WORK_JET ? (uint8_t)node->step.option : 0,
                       .station = kind == WORK_MOVE ? (uint8_t)node->step.option : 0,
                       .layer = node->step.key.layer,
                       .pattern = &node->pattern};
    return node->hal->begin(node->hal->context, &work);
}

static void enter(Node *node, StepPhase phase) {
    node->step.phase = phase;
    node->step.phase_began = node->now;
}

static bool energise(Node *node) {
    switch (node->step.kind) {
    case STEP_HOME:
        return begin_work(node, WORK_HOME);
    case STEP_MOVE:
        return begin_work(node, WORK_MOVE);
    case STEP_PURGE:
        return begin_work(node, WORK_PURGE);
    case STEP_PASS:
        enter(node, STEP_OPENING);
        node->state = NODE_PRINTING;
        return interlocks_gate_open(node);
    case STEP_CURE:
        node->state = NODE_CURING;
        return interlocks_lamp_on(node);
    case STEP_SELF_TEST:
        if (node->step.option)
            return interlocks_lamp_on(node);
        enter(node, STEP_OPENING);
        return interlocks_gate_open(node);
    default:
        node->state = NODE_SCANNING;
        return begin_work(node, WORK_SCAN);
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

/* Begins the layer of a cure or scan, if it is new to this node; a transfer of the layer before is ended. */
static void open_layer(Node *node, StepKind kind, const Key *key) {
    LayerProgress *progress = &node->progress;
    const bool same = progress->job == key->job && progress->layer == key->layer;
    if (!same)
        *progress = (LayerProgress){.job = key->job, .layer = key->layer, .boots = progress->boots};
    if (!same || kind == STEP_SCAN) /* blocks of a map belong to one scan */
        node->scanned = false;
    if (node->transfer.active)
        node->transfer.active = node->transfer.ended = false;
}

Cause steps_begin(Node *node, StepKind kind, uint16_t routine, const Key *key, uint16_t option) {
    if (kind == STEP_CURE || kind == STEP_SCAN)
        open_layer(node, kind, key);
    const Cause cause = is_journalled(kind) ? node_record(node, RECORD_INTENT, kind, key) : CAUSE_NONE;
    if (cause != CAUSE_NONE)
        return cause;
    node->step = (Step){.kind = kind,
                        .key = *key,
                        .routine = routine,
                        .option = option,
                        .began = node->now,
                        .expires_in = limit_of(node, kind, option),
                        .busy_sent_at = node->now};
    return CAUSE_NONE;
}

/* Energises by the clock of this tick: recording the INTENT may have taken the time of an erasure. */
static Cause begin(Node *node) {
    enter(node, STEP_WORKING);
    node->step.began = node->now;
    return energise(node) ? CAUSE_NONE : cause_of(node->step.kind);
}

bool steps_is_done(const Node *node, const Step *step) {
    const LayerProgress *progress = &node->progress;
    const uint8_t bit = (uint8_t)(1u << (step->key.pass % PASSES_MAX));
    return step->kind == STEP_PASS ? (progress->done & bit) != 0 : step->phase == STEP_CLOSING;
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

/* Records the DONE of the step that has just ended. */
static Cause note_done(Node *node) {
    const Step *step = &node->step;
    LayerProgress *progress = &node->progress;
    const uint8_t bit = (uint8_t)(1u << (step->key.pass % PASSES_MAX));
    if (step->kind == STEP_PASS)
        progress->done |= bit;
    if (step->kind == STEP_CURE) {
        progress->cured |= node_has(node, ROLE_HEAD) ? (uint8_t)(progress->done | progress->unknown) : bit;
        progress->flags &= (uint8_t)~LAYER_CURE_UNKNOWN;
    }
    return is_journalled(step->kind) ? node_record(node, RECORD_DONE, step->kind, &step->key) : CAUSE_NONE;
}

static Cause continue_pass(Node *node, WorkProgress work) {
    const bool expired = node->now - node->step.phase_began >= node->options.limits.gate;
    if (node->step.phase == STEP_OPENING) {
        if (node->dry || interlocks_gate_is_open(node)) {
            enter(node, STEP_WORKING);
            return begin_work(node, WORK_JET) ? CAUSE_NONE : CAUSE_BACK_PRESSURE;
        }
        return expired ? CAUSE_GATE_NOT_CONFIRMED : CAUSE_NONE;
    }
    if (node->step.phase == STEP_WORKING && work == WORK_FINISHED) {
        interlocks_gate_close(node);
        enter(node, STEP_CLOSING);
        return note_done(node);
    }
    if (node->step.phase == STEP_CLOSING) {
        if (!node->dry && !interlocks_gate_is_closed(node))
            return expired ? CAUSE_GATE_NOT_CONFIRMED : CAUSE_NONE;
        node->state = NODE_PRINTED;
        answer_done(node);
    }
    return CAUSE_NONE;
}

static Cause continue_cure(Node *node) {
    if (node->step.phase == STEP_WORKING && node->now - node->step.phase_began >= node->step.option) {
        if (!node->dry && !interlocks_line(node, LINE_LAMP_ON)) /* without light the ink is not cured */
            return CAUSE_LAMP_TIME;
        interlocks_lamp_off(node);
        enter(node, STEP_CLOSING);
        return note_done(node);
    }
    if (node->step.phase == STEP_CLOSING && (node->dry || !interlocks_line(node, LINE_LAMP_ON))) {
        node->state = NODE_CURED;
        answer_done(node);
    }
    return CAUSE_NONE;
}

/* Moves the gate to its open end and back, or lights the lamp briefly: nothing is jetted, no layer is changed. */
static Cause continue_self_test(Node *node) {
    const uint32_t lasted = node->now - node->step.phase_began;
    const bool expired = lasted >= node->options.limits.gate;
    if (node->step.phase == STEP_OPENING && interlocks_gate_is_open(node)) {
        interlocks_gate_close(node);
        enter(node, STEP_CLOSING);
    } else if (node->step.phase == STEP_WORKING && lasted >= node->step.option) {
        const bool lit = interlocks_line(node, LINE_LAMP_ON);
        interlocks_lamp_off(node);
        enter(node, STEP_CLOSING);
        return lit ? CAUSE_NONE : CAUSE_LAMP_TIME;
    } else if (node->step.phase == STEP_CLOSING && interlocks_gate_is_closed(node) &&
               !interlocks_line(node, LINE_LAMP_ON)) {
        answer_done(node);
    } else if (node->step.phase != STEP_WORKING && expired) {
        return node->step.option ? CAUSE_LAMP_TIME : CAUSE_GATE_NOT_CONFIRMED;
    }
    return CAUSE_NONE;
}

static Cause continue_work(Node *node, WorkProgress work) {
    if (work != WORK_FINISHED)
        return CAUSE_NONE;
    const Cause cause = note_done(node);
    if (cause != CAUSE_NONE)
        return cause;
    if (node->step.kind == STEP_SCAN) {
        node->scanned = true;
        node->scan_attempt = node->step.key.attempt;
        node->state = NODE_MAP_READY;
    }
    answer_done(node);
    return CAUSE_NONE;
}

static Cause continue_step(Node *node) {
    const StepKind kind = node->step.kind;
    if (node->step.phase == STEP_INTENDED)
        return begin(node);
    const bool working = node->step.phase == STEP_WORKING && kind != STEP_CURE && kind != STEP_SELF_TEST;
    const WorkProgress work = working ? node->hal->progress(node->hal->context) : WORK_RUNNING;
    if (work == WORK_FAILED)
        return cause_of(kind);
    if (work == WORK_NOT_STORED)
        return CAUSE_STORAGE_FAILED;
    switch (kind) {
    case STEP_PASS:
        return continue_pass(node, work);
    case STEP_CURE:
        return continue_cure(node);
    case STEP_SELF_TEST:
        return continue_self_test(node);
    default:
        return continue_work(node, work);
    }
}

Cause steps_continue(Node *node) {
    const Cause cause = node->step.kind == STEP_NONE ? CAUSE_NONE : continue_step(node);
    const bool under_way = cause == CAUSE_NONE && node->step.kind != STEP_NONE;
    if (under_way && node->now - node->step.busy_sent_at >= node->options.limits.pending) {
        node->answer_length = (uint8_t)uds_refusal(node->answer, UDS_ROUTINE_CONTROL, UDS_PENDING);
        node->step.busy_sent_at = node->now;
    }
    return cause;
}
