/* From reset to main on a Cortex-M3: vectors, memory, and a clock of milliseconds by SysTick. */
#include "startup.h"

enum { CORE_HZ = 25000000, SYSTICK_ON = 7 /* core clock, interrupt, enabled */ };
static volatile uint32_t *const SYSTICK_CONTROL = (volatile uint32_t *)0xE000E010u;
static volatile uint32_t *const SYSTICK_RELOAD = (volatile uint32_t *)0xE000E014u;
static volatile uint32_t *const SYSTICK_VALUE = (volatile uint32_t *)0xE000E018u;

extern uint32_t data_begin[], data_end[], data_image[], bss_begin[], bss_end[], stack_top[];
int main(void);
void reset(void);

static volatile uint32_t milliseconds;

static void systick(void) {
    milliseconds++;
}

static void stop(void) {
    for (;;) {
    }
}

void reset(void) {
    for (uint32_t *to = data_begin, *from = data_image; to < data_end;)
        *to++ = *from++;
    for (uint32_t *to = bss_begin; to < bss_end;)
        *to++ = 0;
    *SYSTICK_RELOAD = CORE_HZ / 1000 - 1;
    *SYSTICK_VALUE = 0;
    *SYSTICK_CONTROL = SYSTICK_ON;
    main();
    stop();
}

uint32_t clock_ms(void) {
    return milliseconds;
}

typedef void Handler(void);

typedef struct {
    uint32_t *stack;
    Handler *handler[15];
} Vectors;

__attribute__((section(".vectors"), used)) static const Vectors VECTORS = {
    .stack = stack_top, .handler = {reset, stop, stop, stop, stop, stop, 0, 0, 0, 0, stop, stop, 0, stop, systick}};
