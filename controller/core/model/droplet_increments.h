/* What the droplets of a layer add to each cell, as a linear function of the ink's three heights. */
#ifndef INKLOOP_DROPLET_INCREMENTS_H
#define INKLOOP_DROPLET_INCREMENTS_H

#include "instruction_sets.h"
#include "layer_map.h"

enum { INKS_MAX = 2, ORDERS = 3 }; /* h1, h2, h3 of an ink */

/* A layer that was jetted: nx * ny cells in C order. */
typedef struct {
    size_t nx, ny;
    const int32_t *pattern; /* 0 none, 1 + index of the ink */
    const double *factor;   /* volume of each droplet [1]; NULL: all 1 */
    int32_t passes;         /* 1, or 4 in the colours `order`, each on the surface that the last one left */
    const int32_t *order;
    size_t threads; /* to look at it with; the bits of what is found do not depend on it */
} JettedLayer;

/* Maps of nx * ny cells. `rates`: for each ink its three, height added per metre of h1, h2 and h3 [1]; `squares`: sum
 * over the droplets of the square of what each adds [m^2]; `own`: what the cell's own droplet leaves on it [m]. */
typedef struct {
    double *rates, *squares, *own;
} DropletIncrements;

/* The increments on the surface `height` [m] with the widths of saturation of `ink` (Lu, Zheng, Mishra 2015, eq. 3-7),
 * open edge; `after`: the surface that is left, NULL: not wanted. `scratch` holds 2 * nx * ny for layers of several
 * passes, and may be NULL for one. */
void droplet_increments(const JettedLayer *layer, const double *height, size_t inks, const Ink ink[], double *scratch,
                        const DropletIncrements *increments, double *after);

enum { FLAT_CELLS = 64 }; /* cells of a row that are looked at together */

/* The rates alone on a flat surface, all droplets at once: whatever the ink, every neighbour takes its full part. Of
 * `count` cells of a row from `first` on; each of the inks * ORDERS has FLAT_CELLS places. */
void flat_rates(const JettedLayer *layer, size_t inks, size_t row, size_t first, size_t count, double *rates);

/* Height that the droplets add to `count` cells from `first` on [m] with the heights of `ink`. */
static INLINED void added_heights(const DropletIncrements *increments, size_t cells, size_t first, size_t count,
                                  size_t inks, const Ink ink[], double *restrict added) {
    const double *rate = increments->rates + first;
    for (size_t k = 0; k < count; k++)
        added[k] = 0.0;
    for (size_t number = 0; number < inks; number++, rate += ORDERS * cells) {
        const Ink one = ink[number];
        for (size_t k = 0; k < count; k++)
            added[k] = added[k] + one.h1 * rate[k] + one.h2 * rate[cells + k] + one.h3 * rate[2 * cells + k];
    }
}

/* h1, h2 or h3 by its order, 0 to 2. */
static inline double ink_height(const Ink *ink, size_t order) {
    return order == 0 ? ink->h1 : order == 1 ? ink->h2 : ink->h3;
}

#endif
