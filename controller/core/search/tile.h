/* A tile of the grid: the cells that a sweep works on before it goes on to others. */
#ifndef INKLOOP_TILE_H
#define INKLOOP_TILE_H

#include <stddef.h>

enum { TILE = 64 }; /* cells on a side (assumed); windows of two tiles of one colour do not overlap */

typedef struct {
    size_t top, bottom, left, right; /* cells of the grid, ends excluded */
} Tile;

#endif
