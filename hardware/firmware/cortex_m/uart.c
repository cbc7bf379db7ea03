#include "uart.h"

typedef struct {
    volatile uint32_t data, state, control, interrupt, divider;
} Uart;

static Uart *const UART0 = (Uart *)0x40004000u;
enum { SEND_FULL = 1, RECEIVED = 2, SEND_AND_RECEIVE = 3, CLOCKS_PER_BIT = 16 };

void uart_init(void) {
    UART0->divider = CLOCKS_PER_BIT;
    UART0->control = SEND_AND_RECEIVE;
}

bool uart_take(uint8_t *byte) {
    if (!(UART0->state & RECEIVED))
        return false;
    *byte = (uint8_t)UART0->data;
    return true;
}

void uart_send(const char *bytes, size_t length) {
    for (size_t k = 0; k < length; k++) {
        while (UART0->state & SEND_FULL) {
        }
        UART0->data = (uint8_t)bytes[k];
    }
}
