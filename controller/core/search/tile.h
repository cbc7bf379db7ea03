/* A tile of the grid: cells that a sweep finishes before the next ones. */
#ifndef INKLOOP_TILE_H
#define INKLOOP_TILE_H

#include <stddef.h>

enum { TILE = 64 }; /* cells on a side (assumed); windows of two tiles of one colour do not overlap */

typedef struct {
    size_t top, bottom, left, right; /* cells of the grid, ends excluded */
} Tile;

#endif
