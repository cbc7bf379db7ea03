#include "clock.h"

enum { SYSTICK_ON = 7 /* core clock, interrupt, enabled */ };
static volatile uint32_t *const SYSTICK_CONTROL = (volatile uint32_t *)0xE000E010u;
static volatile uint32_t *const SYSTICK_RELOAD = (volatile uint32_t *)0xE000E014u;
static volatile uint32_t *const SYSTICK_VALUE = (volatile uint32_t *)0xE000E018u;

static volatile uint32_t milliseconds;

void clock_start(void) {
    *SYSTICK_RELOAD = CORE_HZ / 1000 - 1;
    *SYSTICK_VALUE = 0;
    *SYSTICK_CONTROL = SYSTICK_ON;
}

void clock_tick(void) {
    milliseconds++;
}

uint32_t clock_ms(void) {
    return milliseconds;
}
