#include "e2e.h"

enum { POLYNOMIAL = 0x1D, COUNTER_MASK = 0x0F };

static uint8_t crc8(uint8_t crc, uint8_t byte) {
    crc ^= byte;
    for (int bit = 0; bit < 8; bit++)
        crc = (uint8_t)(crc & 0x80 ? (unsigned)crc << 1 ^ POLYNOMIAL : (unsigned)crc << 1);
    return crc;
}

static uint8_t check_byte(const uint8_t *data, size_t length, uint16_t data_id) {
    uint8_t crc = crc8(crc8(0, (uint8_t)(data_id & 0xFF)), (uint8_t)(data_id >> 8));
    for (size_t i = 1; i < length; i++)
        crc = crc8(crc, data[i]);
    return crc;
}

void e2e_protect(uint8_t *data, size_t length, uint16_t data_id, uint8_t counter) {
    data[1] = (uint8_t)((data[1] & ~COUNTER_MASK) | (counter & COUNTER_MASK));
    data[0] = check_byte(data, length, data_id);
}

bool e2e_check(const uint8_t *data, size_t length, uint16_t data_id) {
    return length >= E2E_LENGTH_MIN && data[0] == check_byte(data, length, data_id);
}

uint8_t e2e_counter(const uint8_t *data) {
    return data[1] & COUNTER_MASK;
}

uint8_t e2e_next_counter(uint8_t counter) {
    return counter >= E2E_COUNTER_MAX ? 0 : (uint8_t)(counter + 1);
}
