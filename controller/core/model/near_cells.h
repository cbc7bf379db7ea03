/* A cell and its neighbours by a side or a corner. */
#ifndef INKLOOP_NEAR_CELLS_H
#define INKLOOP_NEAR_CELLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "instruction_sets.h"

/* Whether the cell or a neighbour is marked; marks: nx * ny cells in C order. */
static inline bool is_near_marked(const uint8_t *marks, size_t nx, size_t ny, size_t cell) {
    const size_t i = cell / ny, j = cell % ny;
    for (size_t row = i > 0 ? i - 1 : 0; row <= i + 1 && row < nx; row++)
        for (size_t column = j > 0 ? j - 1 : 0; column <= j + 1 && column < ny; column++)
            if (marks[row * ny + column])
                return true;
    return false;
}

enum { NEAR_COLUMNS = 256 };

/* Whether each cell of row i or a neighbour of it is marked: 1 or 0 in `near`, ny of them. */
static INLINED void mark_near_row(const uint8_t *marks, size_t nx, size_t ny, size_t i, uint8_t *near) {
    /* whether cell k of these columns or the cell above or below it is marked: at 1 + k */
    uint8_t any[NEAR_COLUMNS + 2];
    for (size_t first = 0; first < ny; first += NEAR_COLUMNS) {
        const size_t count = ny - first < NEAR_COLUMNS ? ny - first : NEAR_COLUMNS;
        const size_t from = first > 0 ? 0 : 1, end = count + (first + count < ny ? 2 : 1);
        const uint8_t *here = marks + i * ny + first + from - 1;
        const uint8_t *above = i > 0 ? here - ny : here, *below = i + 1 < nx ? here + ny : here;
        any[0] = any[count + 1] = 0;
        for (size_t k = from; k < end; k++)
            any[k] = above[k - from] | here[k - from] | below[k - from];
        for (size_t k = 0; k < count; k++)
            near[first + k] = (any[k] | any[k + 1] | any[k + 2]) != 0;
    }
}

#endif
