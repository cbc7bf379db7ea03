#include "layer_map.h"

#include <stdbool.h>

double taken_share(double rise, double width) {
    if (rise >= 0.0)
        return 1.0;
    return rise <= -width ? 0.0 : 1.0 + rise / width;
}

static bool is_inside(size_t nx, size_t ny, size_t i, size_t j, int di, int dj) {
    return (di >= 0 || i > 0) && (di <= 0 || i + 1 < nx) && (dj >= 0 || j > 0) && (dj <= 0 || j + 1 < ny);
}

void droplet_shares(const double *height, size_t nx, size_t ny, size_t i, size_t j, const Ink *ink,
                    double share[FOOTPRINT]) {
    const double *here = height + i * ny + j;
    double kept = 0.0;
    for (int di = -1; di <= 1; di++) {
        for (int dj = -1; dj <= 1; dj++) {
            if (di == 0 && dj == 0)
                continue;
            const double spread = di == 0 || dj == 0 ? ink->h2 : ink->h3;
            double taken = spread;
            if (is_inside(nx, ny, i, j, di, dj))
                taken *= taken_share(*here - here[di * (ptrdiff_t)ny + dj], ink->h1 + spread);
            share[3 * (di + 1) + dj + 1] = taken;
            kept += spread - taken;
        }
    }
    share[CENTRE] = ink->h1 + kept;
}

double add_shares(double *height, size_t nx, size_t ny, size_t i, size_t j, const double share[FOOTPRINT]) {
    double *here = height + i * ny + j;
    double lost = 0.0;
    for (int di = -1; di <= 1; di++) {
        for (int dj = -1; dj <= 1; dj++) {
            const double added = share[3 * (di + 1) + dj + 1];
            if (is_inside(nx, ny, i, j, di, dj))
                here[di * (ptrdiff_t)ny + dj] += added;
            else
                lost += added;
        }
    }
    return lost;
}

double deposit_pass(const double *before, double *after, size_t nx, size_t ny, const int32_t *pattern, const Ink ink[2],
                    const double *factor, int colour) {
    double lost = 0.0;
    for (size_t i = 0; i < nx; i++) {
        for (size_t j = 0; j < ny; j++) {
            const size_t cell = i * ny + j;
            if (pattern[cell] == 0 || (colour != COLOUR_ALL && colour != cell_colour(i, j)))
                continue;
            Ink droplet = ink[pattern[cell] - 1];
            if (factor) {
                droplet.h1 *= factor[cell];
                droplet.h2 *= factor[cell];
                droplet.h3 *= factor[cell];
            }
            double share[FOOTPRINT];
            droplet_shares(before, nx, ny, i, j, &droplet, share);
            lost += add_shares(after, nx, ny, i, j, share);
        }
    }
    return lost;
}
