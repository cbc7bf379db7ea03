#include "droplet_increments.h"

#include <stdbool.h>
#include <string.h>

double ink_height(const Ink *ink, size_t order) {
    return order == 0 ? ink->h1 : order == 1 ? ink->h2 : ink->h3;
}

double added_height(const DropletIncrements *increments, size_t cells, size_t cell, size_t inks, const Ink ink[]) {
    double added = 0.0;
    for (size_t k = 0; k < inks; k++)
        for (size_t order = 0; order < ORDERS; order++)
            added += ink_height(&ink[k], order) * increments->rates[(k * ORDERS + order) * cells + cell];
    return added;
}

static void add_droplet(const JettedLayer *layer, const double *before, double *after, size_t i, size_t j,
                        const Ink ink[], const DropletIncrements *increments) {
    const size_t nx = layer->nx, ny = layer->ny, cells = nx * ny, here = i * ny + j;
    const size_t kind = (size_t)(layer->pattern[here] - 1);
    const double volume = layer->factor ? layer->factor[here] : 1.0;
    double *rates = increments->rates + kind * ORDERS * cells;
    double kept[ORDERS] = {volume, 0.0, 0.0}, own = 0.0;
    for (ptrdiff_t row = (ptrdiff_t)i - 1; row <= (ptrdiff_t)i + 1; row++) {
        for (ptrdiff_t column = (ptrdiff_t)j - 1; column <= (ptrdiff_t)j + 1; column++) {
            const bool is_inside = row >= 0 && column >= 0 && row < (ptrdiff_t)nx && column < (ptrdiff_t)ny;
            const size_t cell = is_inside ? (size_t)row * ny + (size_t)column : here;
            if (!is_inside || cell == here)
                continue; /* beyond the open edge all of a share leaves: nothing is kept of it */
            const size_t order = row == (ptrdiff_t)i || column == (ptrdiff_t)j ? 1 : 2;
            const double spread = ink_height(&ink[kind], order) * volume;
            const double share = taken_share(before[here] - before[cell], ink[kind].h1 * volume + spread);
            const double given = share * volume;
            kept[order] += volume - given;
            rates[order * cells + cell] += given;
            increments->squares[cell] += share * spread * (share * spread);
            after[cell] += ink_height(&ink[kind], order) * given;
        }
    }
    for (size_t order = 0; order < ORDERS; order++) {
        own += ink_height(&ink[kind], order) * kept[order];
        rates[order * cells + here] += kept[order];
    }
    increments->squares[here] += own * own;
    increments->own[here] += own;
    after[here] += own;
}

void droplet_increments(const JettedLayer *layer, const double *height, size_t inks, const Ink ink[], double *scratch,
                        const DropletIncrements *increments) {
    const size_t cells = layer->nx * layer->ny, bytes = cells * sizeof(double);
    double *before = scratch, *after = scratch + cells;
    memset(increments->rates, 0, inks * ORDERS * bytes);
    memset(increments->squares, 0, bytes);
    memset(increments->own, 0, bytes);
    memcpy(after, height, bytes);
    for (int32_t pass = 0; pass < layer->passes; pass++) {
        const int colour = layer->passes == 1 ? COLOUR_ALL : layer->order[pass];
        memcpy(before, after, bytes);
        for (size_t cell = 0; cell < cells; cell++) {
            const size_t i = cell / layer->ny, j = cell % layer->ny;
            if (layer->pattern[cell] > 0 && (colour == COLOUR_ALL || colour == cell_colour(i, j)))
                add_droplet(layer, before, after, i, j, ink, increments);
        }
    }
}
