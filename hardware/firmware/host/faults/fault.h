/* A requested fault: which, on which frames or at which step, how often. Text:
 *
 *     KIND[:key=value,...]     loss:probability=1e-3    burst:id=0x640,nth=40    reboot:node=head,step=pass,layer=2
 *
 * Frames and steps are counted, never time, and each arbitration id for itself: with the same seed the same frames are
 * hit. Kinds, keys and defaults: docs/reference/bench-faults.md. */
#ifndef INKLOOP_FAULT_H
#define INKLOOP_FAULT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bench.h"
#include "can_frame.h"

typedef enum {
    FAULT_LOSS, /* frames on their way */
    FAULT_BURST,
    FAULT_CORRUPTION,
    FAULT_DUPLICATION,
    FAULT_SWAP,
    FAULT_DELAY,
    FAULT_FLOW_CONTROL,
    FAULT_MALFORMED_LINE,
    FAULT_STUCK_COUNTER,
    FAULT_BAD_CHECK,
    FAULT_LATE_ANSWER, /* answers of a node */
    FAULT_REPEATED_ANSWER,
    FAULT_SHORT_MAP,
    FAULT_REBOOT, /* nodes, masters and adapters */
    FAULT_DEATH,
    FAULT_HANG,
    FAULT_BROKEN,
    FAULT_SECOND_MASTER,
    FAULT_UNPLUGGED,
    FAULT_BUS_OFF,
    FAULT_KINDS
} FaultKind;

typedef enum { TO_NODES, FROM_NODES, WAYS } Way;

enum { END_SWITCHES = 8 /* part, after those of the defects of a world */ };
enum { ANY = -1, FAULTS_MAX = 16, STANDARD_IDS = CAN_ID_MAX + 1 };

typedef struct {
    FaultKind kind;
    double probability;  /* of each frame; 0: once, at the nth */
    uint32_t nth, count; /* from the nth that fits, this many in a row; nth 0: the first, an event at once */
    uint32_t frames; /* how long: frames that overtake a delayed one, MasterAlive frames of a death; 0: without end */
    int32_t way, id, node, service, byte, part;
    int32_t layer, pass, step; /* it waits until a node is in such a step; ANY: it does not wait */
    int32_t seed;

    uint32_t number; /* its place among the faults */
    bool armed, over;
    uint32_t fitting, left, hits;
    uint32_t seen[STANDARD_IDS];
} Fault;

typedef struct {
    Fault fault[FAULTS_MAX];
    uint32_t count;
} Faults;

/* Arms the faults that waited for a step that a node is in now. Call once per turn. */
void faults_arm(Faults *faults, Bench *bench);

/* Whether a frame on its way is hit. */
bool fault_hits_frame(Fault *fault, Way way, const CanFrame *frame);

/* Whether an answer of a node is hit. */
bool fault_hits_answer(Fault *fault, int node, const uint8_t *answer, size_t length);

/* Whether an event is due; `frame`: one that came from an adapter, NULL in a turn without. */
bool fault_happens(Fault *fault, const CanFrame *frame);

#endif
