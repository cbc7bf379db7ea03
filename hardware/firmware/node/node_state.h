/* The state of one node of the bench: its present step, its limits and interlocks, and its memory.
 *
 *     SAFE -> clear -> IDLE -> RECEIVING -> VERIFIED -> PRINTING -> PRINTED (mask) x passes -> CURING -> CURED
 *          -> SCANNING -> MAP_READY -> RECEIVING of the next layer;   FAULT and SAFE from anywhere
 *
 * A node has one role or several; states of roles it does not have are left out. All parts of the node read and change
 * this struct, but none of them sets SAFE or FAULT: they return a Cause, and node.c acts on it. */
#ifndef INKLOOP_NODE_STATE_H
#define INKLOOP_NODE_STATE_H

#include <stddef.h>

#include "hal.h"
#include "journal.h"
#include "pattern.h"

typedef enum {
    NODE_SAFE,
    NODE_IDLE,
    NODE_RECEIVING,
    NODE_VERIFIED,
    NODE_PRINTING,
    NODE_PRINTED,
    NODE_CURING,
    NODE_CURED,
    NODE_SCANNING,
    NODE_MAP_READY,
    NODE_FAULT
} NodeState; /* value table "State" of inkloop.dbc */

typedef enum {
    CAUSE_NONE,
    CAUSE_MASTER_LOST,
    CAUSE_STOP_REQUEST,
    CAUSE_ENABLE_DROPPED,
    CAUSE_TWO_MASTERS,
    CAUSE_SUPERVISION,
    CAUSE_STEP_EXPIRED,
    CAUSE_GATE_NOT_CONFIRMED,
    CAUSE_LAMP_TIME,
    CAUSE_BACK_PRESSURE = 11,
    CAUSE_STAGE_POSITION,
    CAUSE_SCAN_FAILED = 14,
    CAUSE_JOURNAL_DAMAGED = 16,
    CAUSE_PASS_UNKNOWN,
    CAUSE_STORAGE_FAILED,
    CAUSE_JOURNAL_UNREADABLE
} Cause; /* value table "Fault" of inkloop.dbc; 9, 10, 13 and 15 are not used */

enum { ROLE_HEAD = 1, ROLE_STAGE = 2, ROLE_CURE = 4, ROLE_PROFILER = 8 };
enum { ENABLE_LAMP = 1, ENABLE_GATE = 2, ENABLE_MOTION = 4 };

/* Time limits that a node enforces [ms]. */
typedef struct {
    uint32_t alive;   /* longest silence of MasterAlive before everything is switched off */
    uint32_t lamp;    /* longest pulse of the lamp */
    uint32_t gate;    /* longest time of the gate to its end switch */
    uint32_t pass;    /* longest pass */
    uint32_t motion;  /* longest move, homing or purge */
    uint32_t scan;    /* longest scan */
    uint32_t pending; /* between two "still busy" answers */
} NodeLimits;

typedef struct {
    uint8_t roles; /* ROLE_... */
    NodeLimits limits;
    uint8_t *pattern_memory; /* memory of the head: packed cells of the largest pattern */
    uint32_t pattern_bytes;
    bool by_watchdog; /* the watchdog caused this power-up */
} NodeOptions;

typedef struct {
    uint32_t job;
    uint16_t layer;
    uint8_t pass, attempt;
} Key; /* identifies a step; `attempt` counts repetitions */

typedef struct {
    uint8_t enables; /* ENABLE_... */
    uint16_t session;
    uint32_t job;
} MasterAlive;

/* the INTENT is recorded, the gate opens, the work is done, the gate closes */
typedef enum { STEP_INTENDED, STEP_OPENING, STEP_WORKING, STEP_CLOSING } StepPhase;

/* The step under way. */
typedef struct {
    StepKind kind; /* STEP_NONE: nothing */
    Key key;
    uint16_t routine;
    StepPhase phase;
    uint16_t option;     /* colour of a pass, milliseconds of the lamp, station of a move */
    uint32_t began;      /* [ms] */
    uint32_t expires_in; /* after `began` [ms]: the step takes too long */
    uint32_t phase_began;
    uint32_t busy_sent_at;
} Step;

typedef struct {
    bool active, upload;
    uint8_t next_counter;
    bool any;                       /* at least one block was transferred: its repeat gets the same answer */
    bool ended;                     /* the last transfer succeeded: its exit may be repeated */
    uint32_t size, done, last_size; /* bytes: of all blocks, transferred so far, of the newest block */
    uint32_t crc, crc_before;       /* CRC of the bytes so far; of those before the newest block */
    uint16_t layer;
    uint32_t job;
    NodeState before;
} Transfer;

/* Times of the events that the interlocks depend on [ms of the node's clock]. */
typedef struct {
    uint32_t master_alive, safe, lamp_on, lamp_off, gate_opened, gate_closed;
} NodeTimes;

enum { ANSWER_ROOM = 64 };

typedef struct {
    const Hal *hal;
    NodeOptions options;
    Journal journal;
    LayerProgress progress, progress_before_dry_run;
    Pattern pattern;
    bool pattern_loaded, scanned, dry;
    uint8_t scan_attempt;
    uint8_t session; /* UDS session: SESSION_... of uds.h */
    uint32_t session_since;
    NodeState state;
    Cause cause;
    bool needs_operator; /* clear is refused unless a person confirms it */
    bool stop_active, supervised;
    bool lamp_driven, gate_driven;
    MasterAlive master;
    bool master_seen; /* a master was accepted since power-up */
    /* a master is alive until it is silent for the limit; then it needs a new frame */
    bool master_alive, other_master_alive;
    uint32_t other_master_ms;
    uint16_t other_session;
    uint32_t now;
    Step step;
    uint16_t last_routine; /* the last routine that is not journalled */
    Key last_key;
    Transfer transfer;
    NodeTimes times;
    uint32_t gate_pulses; /* since power-up */
    uint8_t answer[ANSWER_ROOM];
    uint8_t answer_length;
} Node;

bool node_has(const Node *node, uint8_t role);
bool node_is_off(const Node *node); /* SAFE or FAULT */

/* Writes a record with the present progress; CAUSE_NONE, or why it cannot. A dry run writes nothing. */
Cause node_record(Node *node, RecordKind kind, StepKind step, const Key *key);

#endif
