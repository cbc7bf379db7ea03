/* Milliseconds, counted by the SysTick timer of a Cortex-M. */
#ifndef INKLOOP_CLOCK_H
#define INKLOOP_CLOCK_H

#include <stdint.h>

enum { CORE_HZ = 25000000 }; /* core clock of the MPS2 boards */

void clock_start(void);

/* Handler of the timer's interrupt: one millisecond has passed. */
void clock_tick(void);

/* Milliseconds since clock_start; wraps after 49 days. */
uint32_t clock_ms(void);

#endif
