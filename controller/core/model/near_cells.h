/* A cell and its neighbours by a side or a corner. */
#ifndef INKLOOP_NEAR_CELLS_H
#define INKLOOP_NEAR_CELLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Whether one of them is marked; marks: nx * ny cells in C order. */
static inline bool is_near_marked(const uint8_t *marks, size_t nx, size_t ny, size_t cell) {
    const size_t i = cell / ny, j = cell % ny;
    for (size_t row = i > 0 ? i - 1 : 0; row <= i + 1 && row < nx; row++)
        for (size_t column = j > 0 ? j - 1 : 0; column <= j + 1 && column < ny; column++)
            if (marks[row * ny + column])
                return true;
    return false;
}

#endif
