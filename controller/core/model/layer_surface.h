/* Surface after a layer. */
#ifndef INKLOOP_LAYER_SURFACE_H
#define INKLOOP_LAYER_SURFACE_H

#include "droplet_increments.h"

/* Surface `after` one layer on `height` [m]; `after` and, for several passes, `scratch` hold nx * ny. Returns the
 * height that left the grid [m]. */
double layer_surface(const JettedLayer *layer, const double *height, const Ink ink[2], double *scratch, double *after);

#endif
