/* Format of a droplet pattern on the bus and in the head's memory.
 *
 * Transferred: an 8-byte head (version 1, bits per cell 1 or 2, nx, ny, passes 1 or 4, 0), then the cells in C order,
 * most significant bits first, without padding of lines: 0 none, 1 material A, 2 material B. Optionally the cells are
 * run-length coded: a byte c below 128 is followed by c + 1 bytes as they are, any other by one byte that is repeated
 * c - 126 times. */
#ifndef INKLOOP_PATTERN_H
#define INKLOOP_PATTERN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { PATTERN_HEAD_BYTES = 8, PATTERN_VERSION = 1, PATTERN_CELLS_MAX = 1000 * 1000 };

typedef struct {
    uint8_t *cells;    /* memory of the caller */
    uint32_t capacity; /* bytes */
    uint32_t filled;   /* bytes that have arrived, unpacked */
    uint16_t nx, ny;
    uint8_t bits, passes;
    uint8_t head[PATTERN_HEAD_BYTES];
    uint8_t head_filled;
    bool run_length;
    uint8_t literal; /* literal bytes still to come */
    uint8_t repeat;  /* repetitions of the next byte; 0: the next byte is a count */
} Pattern;

/* Empties the pattern; cells arrive next. */
void pattern_begin(Pattern *pattern, bool run_length);

/* Takes the next bytes; false when this node cannot print a pattern with such a head, or when more cells come than it
 * announces. */
bool pattern_take(Pattern *pattern, const uint8_t *bytes, size_t length);

/* Bytes of the packed cells. */
uint32_t pattern_bytes(const Pattern *pattern);

/* Whether all cells have arrived. */
bool pattern_is_complete(const Pattern *pattern);

/* Whether all cells have a material that exists. */
bool pattern_is_printable(const Pattern *pattern);

/* Material of a cell, 0 none. */
uint8_t pattern_cell(const Pattern *pattern, uint32_t cell);

#endif
