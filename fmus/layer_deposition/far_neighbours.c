#include "far_neighbours.h"

#include "layer_map.h"

#include <stdlib.h>
#include <string.h>

/* Adds one droplet of `volume` at cell (i, j); returns the height added outside the grid [m]. */
static double add_far_droplet(const double *before, double *after, size_t nx, size_t ny, size_t i, size_t j,
                              const FarInk *ink, int reach, double volume) {
    const ptrdiff_t row = (ptrdiff_t)i, column = (ptrdiff_t)j, rows = (ptrdiff_t)nx, columns = (ptrdiff_t)ny;
    const size_t here = i * ny + j;
    const double own = ink->h[0] * volume;
    double kept = 0.0, lost = 0.0;
    for (int di = -reach; di <= reach; di++) {
        for (int dj = -reach; dj <= reach; dj++) {
            const int m = abs(di) > abs(dj) ? abs(di) : abs(dj), n = abs(di) + abs(dj) - m;
            const double spread = ink->h[m * (m + 1) / 2 + n] * volume;
            const ptrdiff_t p = row + di, q = column + dj;
            if (m == 0 || spread == 0.0)
                continue;
            if (p < 0 || q < 0 || p >= rows || q >= columns) {
                lost += spread;
                continue;
            }
            const ptrdiff_t cell = p * columns + q;
            const double taken = spread * taken_share(before[here] - before[cell], own + spread);
            after[cell] += taken;
            kept += spread - taken;
        }
    }
    after[here] += own + kept;
    return lost;
}

double deposit_far_pass(const double *before, double *after, size_t nx, size_t ny, const int32_t *pattern,
                        const FarInk ink[2], int reach, const double *factor, int colour) {
    double lost = 0.0;
    memcpy(after, before, nx * ny * sizeof *after);
    for (size_t i = 0; i < nx; i++) {
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            if (pattern[cell] != 0 && (colour == COLOUR_ALL || colour == cell_colour(i, j)))
                lost += add_far_droplet(before, after, nx, ny, i, j, &ink[pattern[cell] - 1], reach, factor[cell]);
        }
    }
    return lost;
}
