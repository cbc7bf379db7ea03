#include "cap_footprint.h"

#include <math.h>
#include <stdlib.h>

double cap_reach(double base_radius, double pitch) {
    return fmax(0.0, ceil(base_radius / pitch - 0.5));
}

CapFootprint cap_footprint(const SphericalCap *cap, double pitch) {
    CapFootprint footprint = {.reach = (int)cap_reach(cap->base_radius, pitch),
                              .height = cap_volume(cap) / (pitch * pitch)};
    double sum = 0.0;
    for (int di = 0; di <= footprint.reach; di++) {
        for (int dj = 0; dj <= footprint.reach; dj++) {
            const double x = di * pitch, y = dj * pitch, half = 0.5 * pitch;
            const double volume = cap_over(cap, x - half, x + half, y - half, y + half).volume;
            footprint.share[di][dj] = volume;
            sum += (di > 0 ? 2.0 : 1.0) * (dj > 0 ? 2.0 : 1.0) * volume;
        }
    }
    /* scaled to sum 1: the volume of a droplet is conserved to rounding */
    for (int di = 0; di <= footprint.reach; di++)
        for (int dj = 0; dj <= footprint.reach; dj++)
            footprint.share[di][dj] /= sum;
    return footprint;
}

double add_cap(double *height, size_t nx, size_t ny, size_t i, size_t j, const CapFootprint *footprint, double volume) {
    const ptrdiff_t row = (ptrdiff_t)i, column = (ptrdiff_t)j;
    const double whole = footprint->height * volume;
    double lost = 0.0;
    for (int di = -footprint->reach; di <= footprint->reach; di++) {
        for (int dj = -footprint->reach; dj <= footprint->reach; dj++) {
            const double added = whole * footprint->share[abs(di)][abs(dj)];
            const ptrdiff_t p = row + di, q = column + dj;
            if (p >= 0 && q >= 0 && p < (ptrdiff_t)nx && q < (ptrdiff_t)ny)
                height[p * (ptrdiff_t)ny + q] += added;
            else
                lost += added;
        }
    }
    return lost;
}
