/* What the start-up code offers. */
#ifndef INKLOOP_STARTUP_H
#define INKLOOP_STARTUP_H

#include <stdint.h>

/* Since power-up; it wraps after 49 days. */
uint32_t clock_ms(void);

#endif
