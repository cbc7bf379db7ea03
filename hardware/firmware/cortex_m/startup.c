/* From reset to main on a Cortex-M3: vectors and memory. */
#include "clock.h"

extern uint32_t data_begin[], data_end[], data_image[], bss_begin[], bss_end[], stack_top[];
int main(void);
void reset(void);

static void stop(void) {
    for (;;) {
    }
}

void reset(void) {
    for (uint32_t *to = data_begin, *from = data_image; to < data_end;)
        *to++ = *from++;
    for (uint32_t *to = bss_begin; to < bss_end;)
        *to++ = 0;
    clock_start();
    main();
    stop();
}

typedef void Handler(void);

typedef struct {
    uint32_t *stack;
    Handler *handler[15];
} Vectors;

__attribute__((section(".vectors"), used)) static const Vectors VECTORS = {
    .stack = stack_top, .handler = {reset, stop, stop, stop, stop, stop, 0, 0, 0, 0, stop, stop, 0, stop, clock_tick}};
