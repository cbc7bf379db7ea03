#include "layer_order.h"

static uint8_t all_passes(const Book *book) {
    return (uint8_t)((1u << book->passes) - 1u);
}

static uint8_t touched(const Book *book) {
    return (uint8_t)(book->done | book->unknown);
}

bool layer_is_begun(const Book *book) {
    return touched(book) != 0;
}

bool layer_is_finished(const Book *book) {
    return book->done == all_passes(book);
}

bool layer_is_closed(const Book *book) {
    return book->unknown != 0 || (book->flags & BOOK_ABANDONED) != 0;
}

static bool is_of(const Book *book, const Key *key) {
    return book->job == key->job && book->layer == key->layer;
}

/* All that was jetted has been cured, and seen, as far as it is this node's task. */
static bool is_cured(const Node *node) {
    const Book *book = &node->book;
    return !node_has(node, ROLE_CURE) || ((touched(book) & ~book->cured) == 0 && !(book->flags & BOOK_CURE_UNKNOWN));
}

static bool is_seen(const Node *node) {
    return !node_has(node, ROLE_PROFILER) || node->scanned || !layer_is_begun(&node->book);
}

uint8_t order_of_pattern(const Node *node, uint32_t job, uint16_t layer) {
    const Book *book = &node->book;
    const bool same_job = book->job == job, begun = layer_is_begun(book);
    const bool over = layer_is_finished(book) || layer_is_closed(book);
    if (same_job && book->layer == layer && book->passes > 0) /* begun, but lost with the memory: the same one again */
        return over || (begun && node->pattern_loaded) ? UDS_SEQUENCE : UDS_OK;
    if (layer == 0 || (same_job && layer <= book->layer)) /* printed before */
        return UDS_SEQUENCE;
    if (same_job && book->passes > 0 && layer != book->layer + 1) /* one would be left out */
        return UDS_SEQUENCE;
    const bool may_leave = over || (!same_job && !begun);
    return may_leave && is_cured(node) && is_seen(node) ? UDS_OK : UDS_SEQUENCE;
}

uint8_t order_of_pass(const Node *node, const Key *key) {
    const Book *book = &node->book;
    if (!node->pattern_loaded || !is_of(book, key) || layer_is_closed(book))
        return UDS_SEQUENCE;
    if (key->pass >= book->passes)
        return UDS_OUT_OF_RANGE;
    const uint8_t before = (uint8_t)((1u << key->pass) - 1u);
    return book->done == before ? UDS_OK : UDS_SEQUENCE;
}

uint8_t order_of_cure(const Node *node, const Key *key) {
    const Book *book = &node->book;
    if (key->pass >= PASSES_MAX)
        return UDS_OUT_OF_RANGE;
    if (node_has(node, ROLE_HEAD))
        return is_of(book, key) && ((touched(book) & (1u << key->pass)) != 0) ? UDS_OK : UDS_SEQUENCE;
    return book->job == key->job && key->layer < book->layer ? UDS_SEQUENCE : UDS_OK;
}

uint8_t order_of_scan(const Node *node, const Key *key) {
    const Book *book = &node->book;
    if (key->pass >= PASSES_MAX)
        return UDS_OUT_OF_RANGE;
    if (book->job == key->job && key->layer < book->layer)
        return UDS_SEQUENCE;
    if (node_has(node, ROLE_HEAD)) {
        const bool fresh = book->passes == 0;
        if (!fresh && (!is_of(book, key) || !(layer_is_finished(book) || layer_is_closed(book))))
            return UDS_SEQUENCE;
    }
    return is_cured(node) ? UDS_OK : UDS_SEQUENCE;
}

Outcome outcome_of(const Node *node, StepKind kind, const Key *key) {
    const Book *book = &node->book;
    const Step *step = &node->step;
    const bool same = step->key.job == key->job && step->key.layer == key->layer && step->key.pass == key->pass;
    if (step->kind == kind && same && (kind != STEP_SCAN || step->key.attempt == key->attempt))
        return OUTCOME_UNDER_WAY;
    if (!is_of(book, key) || key->pass >= PASSES_MAX)
        return OUTCOME_NEVER;
    const uint8_t bit = (uint8_t)(1u << key->pass);
    if (kind == STEP_PASS)
        return book->done & bit ? OUTCOME_DONE_BEFORE : book->unknown & bit ? OUTCOME_UNKNOWN : OUTCOME_NEVER;
    if (kind == STEP_CURE)
        return book->flags & BOOK_CURE_UNKNOWN ? OUTCOME_UNKNOWN
               : book->cured & bit             ? OUTCOME_DONE_BEFORE
                                               : OUTCOME_NEVER;
    return node->scanned && node->scan_attempt == key->attempt ? OUTCOME_DONE_BEFORE : OUTCOME_NEVER;
}
