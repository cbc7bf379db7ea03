/* The layer map with a larger neighbourhood: (2 reach + 1)^2 cells instead of 3 x 3, by the same rule for each of them.
 */
#ifndef INKLOOP_FAR_NEIGHBOURS_H
#define INKLOOP_FAR_NEIGHBOURS_H

#include <stddef.h>
#include <stdint.h>

enum { FURTHEST_REACH = 3, HEIGHT_COUNT = 10 };

/* h[0] is added to the cell itself; a neighbour m cells away along one axis and n <= m along the other receives
 * h[m (m + 1) / 2 + n] on a flat surface [m]. h[0..2] are h1, h2, h3 of layer_map.h. */
typedef struct {
    double h[HEIGHT_COUNT];
} FarInk;

/* deposit_pass of layer_map.h for a reach of 1..FURTHEST_REACH. */
double deposit_far_pass(const double *before, double *after, size_t nx, size_t ny, const int32_t *pattern,
                        const FarInk ink[2], int reach, const double *factor, int colour);

#endif
