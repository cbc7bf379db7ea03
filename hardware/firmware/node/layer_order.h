/* Order of steps in a layer: patterns, passes, cures and scans that the progress of a node allows next. */
#ifndef INKLOOP_LAYER_ORDER_H
#define INKLOOP_LAYER_ORDER_H

#include "uds.h"

/* Whether one of its passes was begun, completed or not. */
bool layer_is_begun(const LayerProgress *progress);

/* Whether all its passes were jetted. */
bool layer_is_finished(const LayerProgress *progress);

/* Whether no further pass will be jetted: one is unknown, or a person abandoned the layer. */
bool layer_is_closed(const LayerProgress *progress);

/* UDS_OK, or the code that refuses the pattern of a layer. */
uint8_t order_of_pattern(const Node *node, uint32_t job, uint16_t layer);

/* UDS_OK, or the code that refuses to begin the step; for steps that outcome_of does not report as done. */
uint8_t order_of_pass(const Node *node, const Key *key);
uint8_t order_of_cure(const Node *node, const Key *key);
uint8_t order_of_scan(const Node *node, const Key *key);

/* Outcome of a pass, cure or scan as recorded by the node. */
Outcome outcome_of(const Node *node, StepKind kind, const Key *key);

#endif
