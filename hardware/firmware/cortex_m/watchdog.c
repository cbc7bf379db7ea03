#include "watchdog.h"

#include "clock.h"

enum { COUNTS_DOWN_TWICE = 2, RESETS = 3 /* interrupt enabled, reset enabled */, UNLOCKED = 0x1ACCE551 };
static volatile uint32_t *const LOAD = (volatile uint32_t *)0x40008000u;
static volatile uint32_t *const CONTROL = (volatile uint32_t *)0x40008008u;
static volatile uint32_t *const CLEAR = (volatile uint32_t *)0x4000800Cu;
static volatile uint32_t *const LOCK = (volatile uint32_t *)0x40008C00u;

/* Restarts the watchdog. It counts down once to the NMI, whose handler waits, and a second time to the reset. */
void watchdog_kick(void) {
    *LOCK = UNLOCKED;
    if (*CONTROL != RESETS) {
        *LOAD = CORE_HZ / 1000 * WATCHDOG_MS / COUNTS_DOWN_TWICE;
        *CONTROL = RESETS;
    }
    *CLEAR = 1;
    *LOCK = 0;
}
