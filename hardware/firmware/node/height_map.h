/* The last scan as the byte string that crosses the bus: a 12-byte head (version 1, 0, nx, ny, nanometres per step,
 * steps to add to every reading as a signed number), the readings as signed 16-bit numbers in C order, then one bit per
 * cell, most significant first: valid. All numbers big-endian; a cell that is not valid reads 0. */
#ifndef INKLOOP_HEIGHT_MAP_H
#define INKLOOP_HEIGHT_MAP_H

#include "hal.h"

enum { MAP_HEAD_BYTES = 12, MAP_VERSION = 1 };

uint32_t height_map_bytes(const Hal *hal);

/* Reads any part of it; from + length <= height_map_bytes. */
void height_map_read(const Hal *hal, uint32_t from, uint8_t *to, uint32_t length);

#endif
