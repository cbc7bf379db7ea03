/* The 2x2 colouring of a layer of four passes (Lu et al. 2015, section V-D): each pass jets the cells of one colour. */
#ifndef INKLOOP_PASS_COLOUR_H
#define INKLOOP_PASS_COLOUR_H

#include <stddef.h>
#include <stdint.h>

enum { COLOUR_ALL = -1, COLOURS = 4 }; /* COLOUR_ALL: the colour of a pass that jets every cell */

/* Colour 0 to 3 of cell (i, j). */
static inline int cell_colour(size_t i, size_t j) {
    return (int)(2 * (i % 2) + j % 2);
}

typedef struct {
    int32_t passes;   /* 1 or 4 */
    int64_t order;    /* of the colours: 1 raster, 2 diagonal */
    int32_t rotation; /* layer n starts rotation * n positions later in the order */
} Passes;

/* Colour of the cells that a pass (from 0 on) of layer `layer` jets, or COLOUR_ALL. */
static inline int pass_colour(const Passes *how, int32_t layer, int pass) {
    static const int ORDERS_OF_COLOURS[2][COLOURS] = {{0, 1, 2, 3}, {0, 3, 1, 2}}; /* order - 1, place -> colour */
    const int64_t place = ((int64_t)how->rotation * layer + pass) % COLOURS;
    return how->passes == 1 ? COLOUR_ALL : ORDERS_OF_COLOURS[how->order - 1][place];
}

#endif
