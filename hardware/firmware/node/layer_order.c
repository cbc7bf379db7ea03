#include "layer_order.h"

static uint8_t all_passes(const LayerProgress *progress) {
    return (uint8_t)((1u << progress->passes) - 1u);
}

static uint8_t touched(const LayerProgress *progress) {
    return (uint8_t)(progress->done | progress->unknown);
}

bool layer_is_begun(const LayerProgress *progress) {
    return touched(progress) != 0;
}

bool layer_is_finished(const LayerProgress *progress) {
    return progress->done == all_passes(progress);
}

bool layer_is_closed(const LayerProgress *progress) {
    return progress->unknown != 0 || (progress->flags & LAYER_ABANDONED) != 0;
}

static bool is_of(const LayerProgress *progress, const Key *key) {
    return progress->job == key->job && progress->layer == key->layer;
}

/* Whether all jetted passes were cured, as far as this node cures. */
static bool is_cured(const Node *node) {
    const LayerProgress *progress = &node->progress;
    return !node_has(node, ROLE_CURE) ||
           ((touched(progress) & ~progress->cured) == 0 && !(progress->flags & LAYER_CURE_UNKNOWN));
}

/* Whether the layer was scanned, as far as this node scans. */
static bool is_seen(const Node *node) {
    return !node_has(node, ROLE_PROFILER) || node->scanned || !layer_is_begun(&node->progress);
}

uint8_t order_of_pattern(const Node *node, uint32_t job, uint16_t layer) {
    const LayerProgress *progress = &node->progress;
    const bool same_job = progress->job == job, begun = layer_is_begun(progress);
    const bool over = layer_is_finished(progress) || layer_is_closed(progress);
    /* begun, but its pattern was lost in a power failure: accept the same one again */
    if (same_job && progress->layer == layer && progress->passes > 0)
        return over || (begun && node->pattern_loaded) ? UDS_SEQUENCE : UDS_OK;
    if (layer == 0 || (same_job && layer <= progress->layer)) /* printed before */
        return UDS_SEQUENCE;
    if (same_job && progress->passes > 0 && layer != progress->layer + 1) /* a layer would be skipped */
        return UDS_SEQUENCE;
    const bool may_leave = over || (!same_job && !begun);
    return may_leave && is_cured(node) && is_seen(node) ? UDS_OK : UDS_SEQUENCE;
}

uint8_t order_of_pass(const Node *node, const Key *key) {
    const LayerProgress *progress = &node->progress;
    if (!node->pattern_loaded || !is_of(progress, key) || layer_is_closed(progress))
        return UDS_SEQUENCE;
    if (key->pass >= progress->passes)
        return UDS_OUT_OF_RANGE;
    const uint8_t before = (uint8_t)((1u << key->pass) - 1u);
    return progress->done == before ? UDS_OK : UDS_SEQUENCE;
}

uint8_t order_of_cure(const Node *node, const Key *key) {
    const LayerProgress *progress = &node->progress;
    if (key->pass >= PASSES_MAX)
        return UDS_OUT_OF_RANGE;
    if (node_has(node, ROLE_HEAD))
        return is_of(progress, key) && ((touched(progress) & (1u << key->pass)) != 0) ? UDS_OK : UDS_SEQUENCE;
    return progress->job == key->job && key->layer < progress->layer ? UDS_SEQUENCE : UDS_OK;
}

uint8_t order_of_scan(const Node *node, const Key *key) {
    const LayerProgress *progress = &node->progress;
    if (key->pass >= PASSES_MAX)
        return UDS_OUT_OF_RANGE;
    if (progress->job == key->job && key->layer < progress->layer)
        return UDS_SEQUENCE;
    if (node_has(node, ROLE_HEAD)) {
        const bool fresh = progress->passes == 0;
        if (!fresh && (!is_of(progress, key) || !(layer_is_finished(progress) || layer_is_closed(progress))))
            return UDS_SEQUENCE;
    }
    return is_cured(node) ? UDS_OK : UDS_SEQUENCE;
}

/* Outcome by the records that could be read. */
static Outcome recorded(const Node *node, StepKind kind, const Key *key) {
    const LayerProgress *progress = &node->progress;
    const Step *step = &node->step;
    const bool same = step->key.job == key->job && step->key.layer == key->layer && step->key.pass == key->pass;
    if (step->kind == kind && same && (kind != STEP_SCAN || step->key.attempt == key->attempt))
        return OUTCOME_UNDER_WAY;
    if (!is_of(progress, key) || key->pass >= PASSES_MAX)
        return OUTCOME_NEVER;
    const uint8_t bit = (uint8_t)(1u << key->pass);
    if (kind == STEP_PASS)
        return progress->done & bit ? OUTCOME_DONE_BEFORE : progress->unknown & bit ? OUTCOME_UNKNOWN : OUTCOME_NEVER;
    if (kind == STEP_CURE)
        return progress->flags & LAYER_CURE_UNKNOWN ? OUTCOME_UNKNOWN
               : progress->cured & bit              ? OUTCOME_DONE_BEFORE
                                                    : OUTCOME_NEVER;
    return node->scanned && node->scan_attempt == key->attempt ? OUTCOME_DONE_BEFORE : OUTCOME_NEVER;
}

Outcome outcome_of(const Node *node, StepKind kind, const Key *key) {
    const Outcome found = recorded(node, kind, key);
    return found == OUTCOME_NEVER && node->journal.unread ? OUTCOME_UNKNOWN : found;
}
