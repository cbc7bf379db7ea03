/* A board for one node that remembers what was really done to it, and the invariants that relate it to the state of the
 * node. Its gate takes 20 ms; everything else that it begins, 50 ms. */
#ifndef INKLOOP_FUZZ_BOARD_H
#define INKLOOP_FUZZ_BOARD_H

#include <setjmp.h>

#include "node.h"

enum {
    FUZZ_SECTORS_MAX = 3,
    FUZZ_SECTOR_BYTES = 256,
    FUZZ_WRITE_UNIT = 8,
    FUZZ_STORAGE_BYTES = FUZZ_SECTORS_MAX * FUZZ_SECTOR_BYTES
};
enum { FUZZ_GATE_MS = 20, FUZZ_WORK_MS = 50, FUZZ_PATTERN_BYTES = 8, LATE_TICK_MS = 255 };

enum { /* what is broken; bits */
       BROKEN_GATE_STAYS_OPEN = 1,
       BROKEN_GATE_STAYS_CLOSED = 2,
       BROKEN_LAMP_STAYS_ON = 4,
       BROKEN_NOT_READY = 8,
       BROKEN_WORK_FAILS = 16,
       BROKEN_WORK_HANGS = 32,
       BROKEN_BEGIN_REFUSED = 64,
       BROKEN_STORAGE = 128
};

/* Passes really jetted of the layer that the journal is at. */
typedef struct {
    uint32_t job;
    uint16_t layer;
    uint8_t opened, finished; /* bit p: droplets of pass p were begun, came to their end */
} Jetted;

typedef struct {
    Hal hal;
    Node *node;
    bool shows; /* states and causes, as they come; set by the environment variable INKLOOP_FUZZ_SHOWS */
    NodeStatus shown;
    uint32_t now;
    uint8_t broken;
    uint8_t storage[FUZZ_STORAGE_BYTES];
    uint32_t blind_from; /* offset from which storage cannot be read; 0: all can */
    bool written_to;     /* since the journal was looked at */
    bool tampered;       /* storage holds records that no node wrote: it proves nothing */
    bool power_fails;    /* in the next write or erasure, after `written` bytes */
    uint32_t written;
    jmp_buf power_failure;
    bool lamp, gate, homed; /* as driven */
    uint32_t lamp_at, gate_at;
    bool working;
    Work work;
    uint32_t work_at;
    uint32_t enabled_at[3]; /* when the master last allowed lamp, gate, motion */
    bool enabled[3];
    uint32_t alive_at; /* when the node last got a MasterAlive */
    uint32_t scans, jets;
    Key seen; /* of the last scan that ended */
    Jetted jetted;
    LayerProgress progress; /* as it was after the last operation */
    bool progress_known;
} FuzzBoard;

void fuzz_board_init(FuzzBoard *board, Node *node, uint8_t sectors);

/* Everything that needs power stops. */
void fuzz_board_power_off(FuzzBoard *board);

/* A MasterAlive was handed to the node. */
void fuzz_board_master_alive(FuzzBoard *board, const MasterAlive *master);

/* Wired inputs as they are now, and whether a living master allows something, by its last frame. */
uint32_t fuzz_board_lines(const FuzzBoard *board);
bool fuzz_board_allows(const FuzzBoard *board, uint8_t enable);

/* Options of a node for it, with limits that are soon reached. */
NodeOptions fuzz_options(uint8_t roles, uint8_t *pattern_memory);

/* Checks the invariants that hold after every tick; invariants.c. */
void fuzz_board_check(FuzzBoard *board);

#endif
