/* Rectangles of cells, counted with the frame of a map: cell (0, 0) of the grid is (1, 1). */
#ifndef INKLOOP_BOX_H
#define INKLOOP_BOX_H

#include <stdbool.h>
#include <stddef.h>

/* Ends included; empty if bottom < top. */
typedef struct {
    ptrdiff_t top, bottom, left, right;
} Box;

static inline bool box_is_empty(const Box *box) {
    return box->bottom < box->top;
}

/* The box widened by one cell on every side, as far as the grid goes. */
static inline Box box_widened(const Box *box, size_t nx, size_t ny) {
    return (Box){box->top > 1 ? box->top - 1 : 1, box->bottom < (ptrdiff_t)nx ? box->bottom + 1 : (ptrdiff_t)nx,
                 box->left > 1 ? box->left - 1 : 1, box->right < (ptrdiff_t)ny ? box->right + 1 : (ptrdiff_t)ny};
}

/* The smallest box that holds both; the other one is not empty. */
static inline Box box_joined(const Box *one, const Box *other) {
    if (box_is_empty(one))
        return *other;
    return (Box){
        one->top < other->top ? one->top : other->top, one->bottom > other->bottom ? one->bottom : other->bottom,
        one->left < other->left ? one->left : other->left, one->right > other->right ? one->right : other->right};
}

#endif
