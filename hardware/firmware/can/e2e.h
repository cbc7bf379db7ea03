/* End-to-end protection of a frame: AUTOSAR E2E profile 1, variant 1A with both bytes of the data id.
 *
 * Byte 0 is the check byte (CRC-8, polynomial 0x1D, start 0, no final exclusive-or, over the data id, low byte first,
 * and bytes 1 to the end); the low half of byte 1 is the alive counter, 0 to 14. e2e_monitor.h evaluates the
 * counter. The protection detects damaged and stale frames; it is no safety function. */
#ifndef INKLOOP_E2E_H
#define INKLOOP_E2E_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { E2E_LENGTH_MIN = 2, E2E_COUNTER_MAX = 14 };

/* Writes counter and check byte; `length` >= E2E_LENGTH_MIN, `counter` <= E2E_COUNTER_MAX. */
void e2e_protect(uint8_t *data, size_t length, uint16_t data_id, uint8_t counter);

/* Whether the check byte is right. */
bool e2e_check(const uint8_t *data, size_t length, uint16_t data_id);

/* Counter of a protected frame; 15 is none. */
uint8_t e2e_counter(const uint8_t *data);

/* The counter of the next frame. */
uint8_t e2e_next_counter(uint8_t counter);

#endif
