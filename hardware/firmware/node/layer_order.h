/* What may come next: which pattern, pass, cure and scan follow from the progress of a node in its layer. */
#ifndef INKLOOP_LAYER_ORDER_H
#define INKLOOP_LAYER_ORDER_H

#include "uds.h"

/* A pass of it was begun, whether or not it was completed. */
bool layer_is_begun(const LayerProgress *progress);

/* All its passes were jetted. */
bool layer_is_finished(const LayerProgress *progress);

/* No further pass will be jetted: one is unknown, or a person abandoned the layer. */
bool layer_is_closed(const LayerProgress *progress);

/* UDS_OK, or the code that refuses the pattern of a layer. */
uint8_t order_of_pattern(const Node *node, uint32_t job, uint16_t layer);

/* UDS_OK, or the code that refuses to begin the step; for steps that outcome_of does not report as done. */
uint8_t order_of_pass(const Node *node, const Key *key);
uint8_t order_of_cure(const Node *node, const Key *key);
uint8_t order_of_scan(const Node *node, const Key *key);

/* What the node knows of a pass, cure or scan. */
Outcome outcome_of(const Node *node, StepKind kind, const Key *key);

#endif
