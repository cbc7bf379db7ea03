/* An ink of the layer map. */
#ifndef INKLOOP_INK_H
#define INKLOOP_INK_H

typedef struct {
    double h1, h2, h3; /* height added to the cell itself, to each side and to each corner neighbour [m] */
} Ink;

#endif
