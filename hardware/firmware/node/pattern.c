#include "pattern.h"

#include "bytes.h"

enum { LITERAL_BELOW = 128, REPEAT_OFFSET = 126, MATERIALS = 2 };

void pattern_begin(Pattern *pattern, bool run_length) {
    pattern->filled = 0;
    pattern->nx = pattern->ny = 0;
    pattern->bits = pattern->passes = 0;
    pattern->head_filled = 0;
    pattern->run_length = run_length;
    pattern->literal = pattern->repeat = 0;
}

uint32_t pattern_bytes(const Pattern *pattern) {
    return ((uint32_t)pattern->nx * pattern->ny * pattern->bits + 7u) / 8u;
}

static bool read_head(Pattern *pattern) {
    const uint8_t *head = pattern->head;
    pattern->bits = head[1];
    pattern->nx = get_u16(head + 2);
    pattern->ny = get_u16(head + 4);
    pattern->passes = head[6];
    const uint32_t cells = (uint32_t)pattern->nx * pattern->ny;
    return head[0] == PATTERN_VERSION && (pattern->bits == 1 || pattern->bits == 2) && cells > 0 &&
           cells <= PATTERN_CELLS_MAX && (pattern->passes == 1 || pattern->passes == 4) && head[7] == 0 &&
           pattern_bytes(pattern) <= pattern->capacity;
}

static bool put_cells(Pattern *pattern, uint8_t byte, uint8_t times) {
    if (times > pattern_bytes(pattern) - pattern->filled)
        return false;
    for (uint8_t k = 0; k < times; k++)
        pattern->cells[pattern->filled++] = byte;
    return true;
}

static bool take_byte(Pattern *pattern, uint8_t byte) {
    if (pattern->head_filled < PATTERN_HEAD_BYTES) {
        pattern->head[pattern->head_filled++] = byte;
        return pattern->head_filled < PATTERN_HEAD_BYTES || read_head(pattern);
    }
    if (!pattern->run_length)
        return put_cells(pattern, byte, 1);
    if (pattern->literal > 0) {
        pattern->literal--;
        return put_cells(pattern, byte, 1);
    }
    if (pattern->repeat > 0) {
        const uint8_t times = pattern->repeat;
        pattern->repeat = 0;
        return put_cells(pattern, byte, times);
    }
    if (byte < LITERAL_BELOW)
        pattern->literal = (uint8_t)(byte + 1);
    else
        pattern->repeat = (uint8_t)(byte - REPEAT_OFFSET);
    return true;
}

bool pattern_take(Pattern *pattern, const uint8_t *bytes, size_t length) {
    for (size_t k = 0; k < length; k++)
        if (!take_byte(pattern, bytes[k]))
            return false;
    return true;
}

bool pattern_is_complete(const Pattern *pattern) {
    return pattern->head_filled == PATTERN_HEAD_BYTES && pattern->filled == pattern_bytes(pattern) &&
           pattern->literal == 0 && pattern->repeat == 0;
}

uint8_t pattern_cell(const Pattern *pattern, uint32_t cell) {
    const uint32_t bit = cell * pattern->bits;
    const uint32_t shift = 8u - pattern->bits - bit % 8u;
    return (uint8_t)(((uint32_t)pattern->cells[bit / 8u] >> shift) & ((1u << pattern->bits) - 1u));
}

bool pattern_is_printable(const Pattern *pattern) {
    const uint32_t cells = (uint32_t)pattern->nx * pattern->ny;
    for (uint32_t cell = 0; cell < cells; cell++)
        if (pattern_cell(pattern, cell) > MATERIALS)
            return false;
    return true;
}
