/* Supervision of one frame by its receiver: check bytes and counters.
 *
 * With two bad frames among the last five the sender counts as missing, until fewer than two of the last five are bad.
 * Silence is not detected here: the caller has the clock. E2eMonitor in link/node_watch.py follows the same rules. */
#ifndef INKLOOP_E2E_MONITOR_H
#define INKLOOP_E2E_MONITOR_H

#include <stdbool.h>
#include <stdint.h>

enum {
    E2E_WINDOW = 5,      /* frames that are considered */
    E2E_BAD_LIMIT = 2,   /* with this many bad ones among them the sender counts as missing */
    E2E_LOST_MAX = 2,    /* frames that may be lost in a row; the third cycle is a missing sender anyway */
    E2E_STUCK_AFTER = 3, /* repeats in a row that make a stuck counter */
};

typedef enum {
    E2E_FIRST,    /* good: nothing to compare with */
    E2E_GOOD,     /* good: the next counter */
    E2E_LOST,     /* good: up to E2E_LOST_MAX frames are missing before it */
    E2E_REPEATED, /* bad: the counter of the last frame */
    E2E_JUMPED,   /* bad: any other counter; the next frame is compared with it */
    E2E_DAMAGED,  /* bad: wrong check byte or a counter of 15; the next frame is compared with the one before it */
} E2eVerdict;

typedef struct {
    uint8_t last;   /* counter of the last undamaged frame */
    bool seen;      /* an undamaged frame has arrived */
    uint8_t bad;    /* the last E2E_WINDOW frames, newest in bit 0: 1 is a bad one */
    uint8_t repeat; /* repeats in a row */
    /* counts of frames; `stuck`: how often the counter stood still */
    uint32_t damaged, repeated, jumped, lost, stuck;
} E2eMonitor;

void e2e_monitor_init(E2eMonitor *monitor);

/* Judges one received frame. */
E2eVerdict e2e_monitor_take(E2eMonitor *monitor, bool check, uint8_t counter);

/* Whether the sender can be trusted: an undamaged frame came, and fewer than E2E_BAD_LIMIT of the last E2E_WINDOW were
 * bad. */
bool e2e_monitor_trusts(const E2eMonitor *monitor);

#endif
