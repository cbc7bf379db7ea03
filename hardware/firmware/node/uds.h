/* Services and codes of ISO 14229 (UDS) that the node knows, and the layout of its answers. */
#ifndef INKLOOP_UDS_H
#define INKLOOP_UDS_H

#include <stddef.h>
#include <stdint.h>

#include "node_state.h"

enum { /* services */
       UDS_SESSION = 0x10,
       UDS_READ = 0x22,
       UDS_ROUTINE_CONTROL = 0x31,
       UDS_DOWNLOAD = 0x34,
       UDS_UPLOAD = 0x35,
       UDS_TRANSFER = 0x36,
       UDS_TRANSFER_EXIT = 0x37,
       UDS_TESTER_PRESENT = 0x3E,
       UDS_POSITIVE = 0x40, /* added to the service in a positive answer */
       UDS_NEGATIVE = 0x7F
};

enum { UDS_START = 1, UDS_STOP = 2, UDS_RESULTS = 3 };
enum { UDS_SUPPRESS = 0x80 /* added to a sub-function: no positive answer is wanted */ };
enum { SESSION_DEFAULT = 1, SESSION_EXTENDED = 3 };

enum { /* negative response codes */
       UDS_OK = 0,
       UDS_SERVICE_NOT_SUPPORTED = 0x11,
       UDS_SUBFUNCTION_NOT_SUPPORTED = 0x12,
       UDS_LENGTH = 0x13,
       UDS_BUSY = 0x21,
       UDS_CONDITIONS = 0x22, /* the node is off, not enabled, not ready, not homed, or a person has to clear it */
       UDS_SEQUENCE = 0x24,   /* not the step that comes next */
       UDS_FAILED = 0x26,     /* begun and abandoned, by an interlock or the device */
       UDS_OUT_OF_RANGE = 0x31,
       UDS_SUSPENDED = 0x71, /* more data than announced */
       UDS_CHECKSUM = 0x72,
       UDS_COUNTER = 0x73,
       UDS_PENDING = 0x78
};

enum { /* routines */
       ROUTINE_CLEAR = 0x0200,
       ROUTINE_HOME,
       ROUTINE_PURGE,
       ROUTINE_PASS,
       ROUTINE_CURE,
       ROUTINE_SCAN,
       ROUTINE_DRY_RUN,
       ROUTINE_MOVE,
       ROUTINE_SELF_TEST
};

typedef enum {
    OUTCOME_DONE,        /* executed by this request */
    OUTCOME_DONE_BEFORE, /* nothing was changed */
    OUTCOME_UNDER_WAY,   /* results only, like those below */
    OUTCOME_UNKNOWN,     /* begun and interrupted at an unknown place */
    OUTCOME_NEVER        /* not begun */
} Outcome;

enum { KEY_BYTES = 8 };

/* The key of a routine, eight bytes: job (4), layer (2), pass, attempt. */
Key uds_key(const uint8_t *bytes);

/* 7F service code; its length. */
size_t uds_refusal(uint8_t *answer, uint8_t service, uint8_t code);

/* 71 kind routine (2), outcome, key (8); its length. */
size_t uds_routine_answer(uint8_t *answer, uint8_t kind, uint16_t routine, Outcome outcome, const Key *key);

#endif
