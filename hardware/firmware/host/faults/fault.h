/* A requested fault: its kind, the frames or the step that it hits, and its frequency. Text:
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
    FAULT_LOSS, /* faults of frames on the wire */
    FAULT_BURST,
    FAULT_CORRUPTION,
    FAULT_DUPLICATION,
    FAULT_SWAP,
    FAULT_DELAY,
    FAULT_FLOW_CONTROL,
    FAULT_MALFORMED_LINE,
    FAULT_TRANSMIT_ORDER,
    FAULT_SHORT_QUEUE,
    FAULT_STUCK_COUNTER,
    FAULT_BAD_CHECK,
    FAULT_LATE_ANSWER, /* faults of a node's answers */
    FAULT_REPEATED_ANSWER,
    FAULT_SHORT_MAP,
    FAULT_REBOOT, /* faults of nodes, masters and adapters */
    FAULT_DEATH,
    FAULT_HANG,
    FAULT_SLOW_ERASE,
    FAULT_UNREADABLE,
    FAULT_BROKEN,
    FAULT_SECOND_MASTER,
    FAULT_UNPLUGGED,
    FAULT_BUS_OFF,
    FAULT_KINDS
} FaultKind;

typedef enum { TO_NODES, FROM_NODES, WAYS } Way;

enum { END_SWITCHES = 8 /* parts, after those of the defects of a world */ };
enum { ANY = -1, FAULTS_MAX = 16, STANDARD_IDS = CAN_ID_MAX + 1 };

typedef struct {
    FaultKind kind;
    double probability; /* probability for each frame; 0: once, at the nth */
    /* first match that is hit, and number of hits in a row; nth 0: the first, an event at once */
    uint32_t nth, count;
    uint32_t
        frames; /* that overtake a delayed one, that fit into a queue, MasterAlive frames of an event; 0: without end */
    int32_t way, id, node, service, byte, part;
    int32_t layer, pass, step; /* node state that arms the fault; ANY: armed from the start */
    int32_t seed;

    uint32_t number; /* index among the faults */
    bool armed, over;
    uint32_t fitting, left, hits;
    uint32_t seen[STANDARD_IDS];
    uint32_t in_block[BENCH_NODES]; /* consecutive frames to a node in their present block */
} Fault;

typedef struct {
    Fault fault[FAULTS_MAX];
    uint32_t count;
} Faults;

/* Arms the faults whose step a node is in now. Call once per turn. */
void faults_arm(Faults *faults, Bench *bench);

/* Whether the fault hits a frame on the wire. */
bool fault_hits_frame(Fault *fault, Way way, const CanFrame *frame);

/* Whether the fault hits an answer of a node. */
bool fault_hits_answer(Fault *fault, int node, const uint8_t *answer, size_t length);

/* Whether an event is due; `frame`: a frame from an adapter, NULL in a turn without. */
bool fault_happens(Fault *fault, const CanFrame *frame);

#endif
