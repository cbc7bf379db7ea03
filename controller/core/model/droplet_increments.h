/* Height that the droplets of a layer add to each cell, as a linear function of the inks: of their volumes, or of their
 * three heights. */
#ifndef INKLOOP_DROPLET_INCREMENTS_H
#define INKLOOP_DROPLET_INCREMENTS_H

#include "instruction_sets.h"
#include "layer_map.h"

enum { INKS_MAX = 2, ORDERS = 3 }; /* h1, h2, h3 of an ink */

/* A layer that was jetted: nx * ny cells in C order. */
typedef struct {
    size_t nx, ny;
    const int32_t *pattern; /* 0 none, 1 + index of the ink */
    const double *factor;   /* volume of each droplet as a share of the nominal one [1]; NULL: all 1 */
    int32_t passes;         /* 1, or 4 in the colours `order`, each on the surface that the last one left */
    const int32_t *order;
    size_t threads; /* threads to use; the bits of the result do not depend on it */
} JettedLayer;

/* Maps of nx * ny cells. `adds`: with a `unit`, for each ink the height its droplets add in the proportions of that
 * unit [m]; without, three maps for each ink, height added per metre of h1, h2 and h3 [1]; `squares`: sum over the
 * droplets of the squares of their shares in the cell [m^2]; `own`: height that the cell's own droplet leaves on it
 * [m]. */
typedef struct {
    const Ink *unit; /* proportions h1 : h2 : h3 of each ink; NULL: h1, h2 and h3 apart */
    double *adds, *squares, *own;
} DropletIncrements;

/* Number of maps of an ink. */
static inline size_t maps_of_ink(const Ink *unit) {
    return unit ? 1 : ORDERS;
}

/* The increments on the surface `height` [m] with the widths of saturation of `ink` (Lu, Zheng, Mishra 2015, eq. 3-7),
 * open edge; `after`: the surface after the layer, NULL if not wanted. `scratch` holds 2 * nx * ny for layers of
 * several passes, and may be NULL for one. */
void droplet_increments(const JettedLayer *layer, const double *height, size_t inks, const Ink ink[], double *scratch,
                        const DropletIncrements *increments, double *after);

/* Height of a full layer on a wide flat surface [m]. */
static inline double full_layer_height(const Ink *ink) {
    return ink->h1 + 4.0 * ink->h2 + 4.0 * ink->h3;
}

/* h1, h2 or h3 by its order, 0 to 2. */
static inline double ink_height(const Ink *ink, size_t order) {
    return order == 0 ? ink->h1 : order == 1 ? ink->h2 : ink->h3;
}

#endif
