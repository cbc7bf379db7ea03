/* The 2x2 colouring of a layer of four passes (Lu et al. 2015, section V-D): each pass jets the cells of one colour. */
#ifndef INKLOOP_CELL_COLOUR_H
#define INKLOOP_CELL_COLOUR_H

#include <stddef.h>

enum { COLOUR_ALL = -1, COLOURS = 4 }; /* COLOUR_ALL: the colour of a pass that jets every cell */

/* Colour 0 to 3 of cell (i, j). */
static inline int cell_colour(size_t i, size_t j) {
    return (int)(2 * (i % 2) + j % 2);
}

#endif
