#include "routines.h"

#include "bytes.h"
#include "interlocks.h"
#include "layer_order.h"
#include "steps.h"

enum { ROUTINE_HEAD = 4 };

typedef struct {
    uint16_t routine;
    StepKind kind; /* STEP_NONE: done at once */
    uint8_t roles; /* roles of which one is needed */
    uint8_t option_bytes;
} Routine;

static const Routine ROUTINES[] = {
    {ROUTINE_CLEAR, STEP_NONE, 0xFF, 1},
    {ROUTINE_HOME, STEP_HOME, ROLE_STAGE, 0},
    {ROUTINE_PURGE, STEP_PURGE, ROLE_HEAD, 0},
    {ROUTINE_PASS, STEP_PASS, ROLE_HEAD, 1},
    {ROUTINE_CURE, STEP_CURE, ROLE_CURE, 2},
    {ROUTINE_SCAN, STEP_SCAN, ROLE_PROFILER, 0},
    {ROUTINE_DRY_RUN, STEP_NONE, 0xFF, 1},
    {ROUTINE_MOVE, STEP_MOVE, ROLE_STAGE, 1},
    {ROUTINE_SELF_TEST, STEP_SELF_TEST, ROLE_HEAD | ROLE_CURE, 2},
};

static const Routine *find(const Node *node, uint16_t number) {
    for (size_t k = 0; k < sizeof ROUTINES / sizeof *ROUTINES; k++)
        if (ROUTINES[k].routine == number && node_has(node, ROUTINES[k].roles))
            return &ROUTINES[k];
    return NULL;
}

static bool same_key(const Key *left, const Key *right) {
    return left->job == right->job && left->layer == right->layer && left->pass == right->pass &&
           left->attempt == right->attempt;
}

/* Gives up an unread journal: any layer of its job may be jetted already, so none of them is taken any more. */
static void close_job(Node *node) {
    const LayerProgress *progress = &node->progress;
    node->progress = (LayerProgress){.job = progress->job, .layer = UINT16_MAX, .boots = progress->boots};
    journal_give_up(&node->journal);
}

static uint8_t clear(Node *node, uint16_t option, Cause *cause) {
    if (option > (CLEAR_OPERATOR | CLEAR_ABANDON))
        return UDS_OUT_OF_RANGE;
    const bool released = (option & CLEAR_OPERATOR) != 0;
    if (node->stop_active || node->journal.damaged || !interlocks_one_master(node))
        return UDS_CONDITIONS;
    if ((node->needs_operator || option & CLEAR_ABANDON) && !released)
        return UDS_CONDITIONS;
    if (node->journal.unread && !(option & CLEAR_ABANDON))
        return UDS_CONDITIONS;
    if (node->journal.unread)
        close_job(node);
    if (released)
        node->progress.flags |= LAYER_ACKNOWLEDGED;
    if (option & CLEAR_ABANDON)
        node->progress.flags |= LAYER_ABANDONED;
    if (released)
        *cause = node_record(node, RECORD_CLEAR, STEP_NONE, NULL);
    if (*cause != CAUSE_NONE)
        return UDS_FAILED;
    node->needs_operator = false;
    node->cause = CAUSE_NONE;
    if (node_is_off(node))
        node->state = NODE_IDLE;
    return UDS_OK;
}

static uint8_t set_dry_run(Node *node, uint16_t option) {
    if (option > 1)
        return UDS_OUT_OF_RANGE;
    const bool dry = option == 1;
    if (node_is_off(node))
        return UDS_CONDITIONS;
    if (dry == node->dry)
        return UDS_OK;
    if (dry && node->state != NODE_IDLE)
        return UDS_SEQUENCE;
    if (dry)
        node->progress_before_dry_run = node->progress;
    else
        node->progress = node->progress_before_dry_run;
    node->dry = dry;
    node->pattern_loaded = node->scanned = false;
    node->transfer.active = node->transfer.ended = false;
    node->state = NODE_IDLE;
    return UDS_OK;
}

static uint8_t conditions_of_pass(const Node *node, uint16_t option) {
    const bool one_pass = node->progress.passes == 1;
    if (one_pass ? option != ALL_COLOURS : option >= COLOUR_COUNT)
        return UDS_OUT_OF_RANGE;
    const bool stage = node_has(node, ROLE_STAGE);
    if (stage && (!interlocks_enabled(node, ENABLE_MOTION) || !interlocks_line(node, LINE_HOMED)))
        return UDS_CONDITIONS;
    if (!interlocks_line(node, LINE_READY) || interlocks_line(node, LINE_LAMP_ON))
        return UDS_CONDITIONS;
    if (node->dry)
        return UDS_OK;
    return interlocks_gate_is_closed(node) && interlocks_enabled(node, ENABLE_GATE) ? UDS_OK : UDS_CONDITIONS;
}

static uint8_t conditions_of_cure(const Node *node, uint16_t option) {
    if (option == 0 || option >= node->options.limits.lamp)
        return UDS_OUT_OF_RANGE;
    if (node->gate_driven || !interlocks_gate_is_closed(node))
        return UDS_CONDITIONS;
    return node->dry || interlocks_enabled(node, ENABLE_LAMP) ? UDS_OK : UDS_CONDITIONS;
}

static uint8_t conditions_of_motion(const Node *node, StepKind kind, uint16_t option) {
    if (kind == STEP_MOVE && option >= STATION_COUNT)
        return UDS_OUT_OF_RANGE;
    if (kind == STEP_PURGE)
        return interlocks_line(node, LINE_READY) ? UDS_OK : UDS_CONDITIONS;
    const bool stage = node_has(node, ROLE_STAGE);
    if (stage && !interlocks_enabled(node, ENABLE_MOTION))
        return UDS_CONDITIONS;
    return kind == STEP_HOME || !stage || interlocks_line(node, LINE_HOMED) ? UDS_OK : UDS_CONDITIONS;
}

/* Conditions of a self-test: of the lamp for `lamp_ms`; 0: of the gate. */
static uint8_t conditions_of_self_test(const Node *node, uint16_t lamp_ms) {
    if (!node_has(node, lamp_ms ? ROLE_CURE : ROLE_HEAD))
        return UDS_OUT_OF_RANGE;
    if (node->dry)
        return UDS_CONDITIONS;
    if (lamp_ms)
        return conditions_of_cure(node, lamp_ms);
    const bool dark = !node->lamp_driven && !interlocks_line(node, LINE_LAMP_ON);
    return dark && interlocks_gate_is_closed(node) && interlocks_enabled(node, ENABLE_GATE) ? UDS_OK : UDS_CONDITIONS;
}

/* Reason why a step cannot begin now: first the order of the layer, then enables and confirmations. UDS_OK if it
 * can. */
static uint8_t refusal_of(const Node *node, StepKind kind, const Key *key, uint16_t option) {
    uint8_t code = UDS_OK;
    if (kind == STEP_PASS)
        code = order_of_pass(node, key);
    if (kind == STEP_CURE)
        code = order_of_cure(node, key);
    if (kind == STEP_SCAN)
        code = order_of_scan(node, key);
    if (code != UDS_OK)
        return code;
    if (kind == STEP_PASS)
        return conditions_of_pass(node, option);
    if (kind == STEP_SELF_TEST)
        return conditions_of_self_test(node, option);
    return kind == STEP_CURE ? conditions_of_cure(node, option) : conditions_of_motion(node, kind, option);
}

static Outcome known(const Node *node, const Routine *routine, const Key *key) {
    if (node->step.kind == routine->kind && routine->kind != STEP_NONE && same_key(&node->step.key, key))
        return OUTCOME_UNDER_WAY;
    if (routine->kind == STEP_PASS || routine->kind == STEP_CURE || routine->kind == STEP_SCAN)
        return outcome_of(node, routine->kind, key);
    return node->last_routine == routine->routine && same_key(&node->last_key, key) ? OUTCOME_DONE_BEFORE
                                                                                    : OUTCOME_NEVER;
}

static size_t start(Node *node, const Routine *routine, const Key *key, uint16_t option, uint8_t *answer,
                    Cause *cause) {
    const Outcome outcome = known(node, routine, key);
    if (outcome == OUTCOME_UNDER_WAY)
        return uds_refusal(answer, UDS_ROUTINE_CONTROL, UDS_PENDING);
    if (outcome == OUTCOME_DONE_BEFORE && routine->kind != STEP_NONE)
        return uds_routine_answer(answer, UDS_START, routine->routine, outcome, key);
    if (node->step.kind != STEP_NONE)
        return uds_refusal(answer, UDS_ROUTINE_CONTROL, UDS_BUSY);
    uint8_t code = UDS_OK;
    if (routine->routine == ROUTINE_CLEAR)
        code = clear(node, option, cause);
    else if (routine->routine == ROUTINE_DRY_RUN)
        code = set_dry_run(node, option);
    else if (node_is_off(node))
        code = UDS_CONDITIONS;
    else
        code = refusal_of(node, routine->kind, key, option);
    if (code != UDS_OK)
        return uds_refusal(answer, UDS_ROUTINE_CONTROL, code);
    if (routine->kind == STEP_NONE)
        return uds_routine_answer(answer, UDS_START, routine->routine, OUTCOME_DONE, key);
    node->answer_length = 0;
    *cause = steps_begin(node, routine->kind, routine->routine, key, option);
    return uds_refusal(answer, UDS_ROUTINE_CONTROL, *cause == CAUSE_NONE ? UDS_PENDING : UDS_FAILED);
}

size_t routine_control(Node *node, const uint8_t *request, size_t length, uint8_t *answer, Cause *cause) {
    if (length < ROUTINE_HEAD)
        return uds_refusal(answer, UDS_ROUTINE_CONTROL, UDS_LENGTH);
    const Routine *routine = find(node, get_u16(request + 2));
    if (!routine)
        return uds_refusal(answer, UDS_ROUTINE_CONTROL, UDS_OUT_OF_RANGE);
    const bool starts = (request[1] & ~UDS_SUPPRESS) == UDS_START;
    if (length != (size_t)ROUTINE_HEAD + KEY_BYTES + (starts ? routine->option_bytes : 0))
        return uds_refusal(answer, UDS_ROUTINE_CONTROL, UDS_LENGTH);
    const Key key = uds_key(request + ROUTINE_HEAD);
    if (!starts)
        return uds_routine_answer(answer, UDS_RESULTS, routine->routine, known(node, routine, &key), &key);
    const uint8_t *option = request + ROUTINE_HEAD + KEY_BYTES;
    const uint16_t value = routine->option_bytes == 2 ? get_u16(option) : routine->option_bytes == 1 ? option[0] : 0;
    return start(node, routine, &key, value, answer, cause);
}
