#include "layer_surface.h"

double layer_surface(const JettedLayer *layer, const double *height, const Ink ink[2], double *scratch, double *after) {
    const double *before = height;
    double lost = 0.0;
    for (int32_t pass = 0; pass < layer->passes; pass++) {
        double *next = (layer->passes - pass) % 2 == 0 ? scratch : after; /* the last one is `after` */
        lost += deposit_pass(before, next, layer->nx, layer->ny, layer->pattern, ink, layer->factor,
                             layer->passes == 1 ? COLOUR_ALL : layer->order[pass]);
        before = next;
    }
    return lost;
}

double full_layer_height(const Ink *ink) {
    return ink->h1 + 4.0 * ink->h2 + 4.0 * ink->h3;
}
