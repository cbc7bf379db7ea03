#include "layer_surface.h"

#include <string.h>

double layer_surface(const JettedLayer *layer, const double *height, const Ink ink[2], double *scratch, double *after) {
    const size_t bytes = layer->nx * layer->ny * sizeof(double);
    memcpy(after, height, bytes);
    if (layer->passes == 1)
        return deposit_pass(height, after, layer->nx, layer->ny, layer->pattern, ink, layer->factor, COLOUR_ALL);
    double lost = 0.0;
    for (int pass = 0; pass < 4; pass++) {
        memcpy(scratch, after, bytes);
        lost +=
            deposit_pass(scratch, after, layer->nx, layer->ny, layer->pattern, ink, layer->factor, layer->order[pass]);
    }
    return lost;
}

double full_layer_height(const Ink *ink) {
    return ink->h1 + 4.0 * ink->h2 + 4.0 * ink->h3;
}
