#include "ink_limit.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

static const double CHANCE = 5.0;    /* standard deviations of the droplets given to a cell (assumed) */
static const double ROUNDING = 1e-9; /* of a layer: a target of whole layers needs no further one */
static const double RESERVE = 1.0;   /* layers: a nozzle that was cleaned or ink that fades needs no cap (by trial) */
static const double HIGH = 0.4;      /* layers above target and reckoning: sound prints show 0.3 (by trial) */
static const double RISEN = 0.9;     /* layers above target and reckoning: no droplets explain it (by trial) */

double ink_limit_at(const InkLimit *limit, size_t cell) {
    const double layers = fmax(1.0, ceil(limit->target[cell] / limit->layer - ROUNDING));
    return (layers + RESERVE) * limit->layer + CHANCE * limit->droplet_std * sqrt(layers);
}

/* How much higher a cell stands than it is to, and than the droplets given to it explain [layers]; 0 or less where it
 * does not: most cells are below their target, and none is divided. */
static double rise(const InkLimit *limit, const double *height, const double *reckoned, size_t cell) {
    const double above = height[cell] - fmax(limit->target[cell], reckoned[cell]);
    return above > 0.0 ? above / limit->layer : 0.0;
}

enum { BLOCK = 64 }; /* cells */

/* Whether cells may be high, or given more than their limit: that is above their target by nearly RESERVE layers. */
static INLINED bool has_doubtful(const InkLimit *limit, const double *height, const double *reckoned, size_t first,
                                 size_t count) {
    const uint8_t *part = limit->part + first;
    const double *target = limit->target + first, own = limit->own;
    uint8_t doubtful = 0;
    for (size_t k = 0; k < count; k++)
        doubtful |= (part[k] != 0) & ((height[first + k] >= target[k]) | (reckoned[first + k] + own > target[k]));
    return doubtful;
}

static bool has_doubtful_plain(const InkLimit *limit, const double *height, const double *reckoned, size_t first,
                               size_t count) {
    return has_doubtful(limit, height, reckoned, first, count);
}

static WITH_AVX2 bool has_doubtful_avx2(const InkLimit *limit, const double *height, const double *reckoned,
                                        size_t first, size_t count) {
    return has_doubtful(limit, height, reckoned, first, count);
}

static void mark_near(size_t nx, size_t ny, size_t cell, const uint8_t *part, uint8_t *marks) {
    const size_t i = cell / ny, j = cell % ny;
    for (size_t row = i > 0 ? i - 1 : 0; row <= i + 1 && row < nx; row++)
        for (size_t column = j > 0 ? j - 1 : 0; column <= j + 1 && column < ny; column++)
            marks[row * ny + column] = part[row * ny + column];
}

/* Looks at a cell of the part; true if it or cells next to it are capped. */
static bool look_at_cell(const InkLimit *limit, const double *height, const double *reckoned, size_t cell,
                         uint8_t *capped, HighCells *high) {
    if (height[cell] < limit->target[cell]) {
        const bool is_over = reckoned[cell] + limit->own > ink_limit_at(limit, cell);
        capped[cell] |= is_over;
        return is_over;
    }
    const double layers = rise(limit, height, reckoned, cell);
    high->count += layers > HIGH;
    if (layers * limit->layer > high->highest) {
        high->highest = layers * limit->layer;
        high->cell = cell;
    }
    if (layers > RISEN)
        mark_near(limit->nx, limit->ny, cell, limit->part, capped);
    return layers > RISEN;
}

size_t mark_capped(const InkLimit *limit, const double *height, const double *reckoned, uint8_t *capped,
                   HighCells *high) {
    const size_t cells = limit->nx * limit->ny;
    size_t count = 0;
    bool is_any = false;
    *high = (HighCells){0, 0.0, 0};
    memset(capped, 0, cells);
    for (size_t first = 0; first < cells; first += BLOCK) {
        const size_t some = cells - first < BLOCK ? cells - first : BLOCK;
        if (!(HAS_AVX2 ? has_doubtful_avx2 : has_doubtful_plain)(limit, height, reckoned, first, some))
            continue;
        for (size_t cell = first; cell < first + some; cell++)
            if (limit->part[cell])
                is_any |= look_at_cell(limit, height, reckoned, cell, capped, high);
    }
    for (size_t cell = 0; is_any && cell < cells; cell++)
        count += capped[cell];
    return count;
}
