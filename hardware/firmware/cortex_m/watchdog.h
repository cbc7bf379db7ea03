/* The CMSDK watchdog of the MPS2 boards: resets the machine unless it is kicked. */
#ifndef INKLOOP_WATCHDOG_H
#define INKLOOP_WATCHDOG_H

/* Starts the watchdog, and restarts its period in later calls; without a call for WATCHDOG_MS the board is reset. */
void watchdog_kick(void);

enum { WATCHDOG_MS = 300 }; /* limits.alive of a node */

#endif
