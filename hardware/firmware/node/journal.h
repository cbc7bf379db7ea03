/* The journal of a node, which outlives a power failure: a ring of records in non-volatile memory.
 *
 * Every record carries the whole progress (which layer, which passes) as well as the event, so that the newest
 * readable record alone shows where the node is. An INTENT is written before anything is energised, a DONE after it
 * ended; an INTENT that is the newest record at power-up is a step whose outcome is unknown. A torn record fails its
 * CRC and counts as never written: nothing had been energised then (INTENT), or the outcome is unknown (DONE). A slot
 * that refuses a record is skipped. A slot that cannot be read at power-up may hold a newer record than the newest
 * readable one, unless its place shows that it is older: nothing is written or energised then until a person gives up
 * what stood there. */
#ifndef INKLOOP_JOURNAL_H
#define INKLOOP_JOURNAL_H

#include "hal.h"

enum { RECORD_BYTES = 40, PASSES_MAX = 4 };

typedef enum {
    RECORD_BOOT = 1, /* power-up; its progress marks interrupted steps as unknown */
    RECORD_PATTERN,  /* a pattern was verified: the progress holds its layer, passes and CRC */
    RECORD_INTENT,   /* a step begins */
    RECORD_DONE,     /* it was completed */
    RECORD_UNKNOWN,  /* it was interrupted */
    RECORD_CLEAR,    /* a person has cleared the node */
    RECORD_WATCHDOG  /* power-up that the watchdog caused; otherwise as RECORD_BOOT */
} RecordKind;

typedef enum { STEP_NONE, STEP_HOME, STEP_MOVE, STEP_PURGE, STEP_PASS, STEP_CURE, STEP_SCAN, STEP_SELF_TEST } StepKind;

enum {
    LAYER_ABANDONED = 1,    /* the layer will not be finished */
    LAYER_CURE_UNKNOWN = 2, /* a cure was interrupted and not repeated yet */
    LAYER_ACKNOWLEDGED = 4  /* a person has acknowledged the unknown step */
};

typedef struct {
    uint32_t job;
    uint16_t layer;
    uint32_t pattern_crc;
    uint8_t passes;  /* of the layer; 0: no pattern belongs to it */
    uint8_t done;    /* bit p: pass p was jetted */
    uint8_t unknown; /* bit p: pass p was interrupted at an unknown place */
    uint8_t cured;   /* bit p: pass p was cured */
    uint8_t flags;   /* LAYER_... */
    uint16_t boots;
} LayerProgress;

typedef struct {
    uint32_t number; /* counts up from 1 over the node's life */
    RecordKind kind;
    StepKind step;
    uint8_t pass, attempt;
    LayerProgress progress;
    uint32_t time_ms; /* since power-up */
} Record;

typedef struct {
    const Hal *hal;
    uint32_t next; /* slot of the next record */
    Record newest; /* number 0: none yet */
    bool damaged;  /* storage refuses writes, or is none for a journal: nothing may be energised until power-up */
    bool unread;   /* a newer record may stand where storage could not be read */
} Journal;

/* Finds the newest record. */
void journal_open(Journal *journal, const Hal *hal);

/* Appends a record and numbers it. False: it could not be written and read back, or the journal is unread. */
bool journal_append(Journal *journal, Record record);

/* Takes whatever could not be read for lost; later records are newer than it. */
void journal_give_up(Journal *journal);

/* Reads up to `most` records, newest first, as stored bytes; returns how many. Those that were given up, and can be
 * read again, are left out. */
uint32_t journal_read(const Journal *journal, uint8_t *to, uint32_t most);

#endif
