/* The first serial port of the MPS2 board (Arm CMSDK APB UART), polled. */
#ifndef INKLOOP_UART_H
#define INKLOOP_UART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

void uart_init(void);

/* False: no byte has arrived. */
bool uart_take(uint8_t *byte);

/* Waits until all bytes are sent. */
void uart_send(const char *bytes, size_t length);

#endif
