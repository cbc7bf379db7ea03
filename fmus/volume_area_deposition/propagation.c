#include "propagation.h"

#include "spherical_cap.h"

#include <math.h>

static const double FLAT = 1e-15; /* height differences up to this are 0 [m] */

/* The region of interest, cut to the grid: rows and columns first..last of 0..2, and the grid cell of its first place.
 */
typedef struct {
    int first_row, last_row, first_column, last_column;
    size_t corner;
} Region;

CapShares cap_shares(double height_scale, double base_radius, double pitch) {
    static const struct {
        int x, y, count;
    } PLACES[SIDE] = {{0, 0, 1}, {1, 0, 4}, {1, 1, 4}};
    const SphericalCap cap = cap_of_volume(height_scale * pitch * pitch, base_radius);
    const double half = 0.5 * pitch;
    CapShares shares;
    double sum = 0.0;
    for (int k = 0; k < SIDE; k++) {
        const double x = PLACES[k].x * pitch, y = PLACES[k].y * pitch;
        const CapPart part = cap_over(&cap, x - half, x + half, y - half, y + half);
        shares.volume[k] = part.volume;
        shares.area[k] = fmin(part.area / (pitch * pitch), 1.0);
        sum += PLACES[k].count * part.volume;
    }
    for (int k = 0; k < SIDE; k++)
        shares.volume[k] /= sum;
    return shares;
}

static Region region_of(const InkMap *map, size_t i, size_t j) {
    Region region = {i == 0 ? 1 : 0, i + 1 == map->nx ? 1 : 2, j == 0 ? 1 : 0, j + 1 == map->ny ? 1 : 2, 0};
    region.corner = (i + (size_t)region.first_row - 1) * map->ny + j + (size_t)region.first_column - 1;
    return region;
}

static size_t cell_of(const InkMap *map, const Region *region, int p, int q) {
    return region->corner + (size_t)(p - region->first_row) * map->ny + (size_t)(q - region->first_column);
}

/* Height of each cell less the mean of the adjacent cells inside the region (eq. 7-9); returns the largest. */
static double height_differences(const InkMap *map, const Region *region, double difference[SIDE][SIDE]) {
    double framed[SIDE + 2][SIDE + 2] = {{0.0}}, along[SIDE + 2][SIDE] = {{0.0}};
    for (int p = region->first_row; p <= region->last_row; p++) {
        for (int q = region->first_column; q <= region->last_column; q++) {
            const size_t cell = cell_of(map, region, p, q);
            const double ink = map->height[cell] - map->substrate[cell];
            framed[p + 1][q + 1] = map->substrate[cell] + (map->area[cell] > 0.0 ? ink / map->area[cell] : 0.0);
        }
        for (int q = 0; q < SIDE; q++)
            along[p + 1][q] = framed[p + 1][q] + framed[p + 1][q + 1] + framed[p + 1][q + 2];
    }
    double largest = 0.0;
    for (int p = region->first_row; p <= region->last_row; p++) {
        const int rows = (p > region->first_row) + 1 + (p < region->last_row);
        for (int q = region->first_column; q <= region->last_column; q++) {
            const int touching = rows * ((q > region->first_column) + 1 + (q < region->last_column)) - 1;
            const double own = framed[p + 1][q + 1], around = along[p][q] + along[p + 1][q] + along[p + 2][q] - own;
            difference[p][q] = touching > 0 ? own - around / touching : 0.0;
            largest = fmax(largest, fabs(difference[p][q]));
        }
    }
    return largest;
}

/* Adds a drop on flat ground as a cap; the part outside the grid stays with the cell that is hit. */
static void add_cap(const InkMap *map, const Region *region, const DropModel *drop, double volume) {
    double left = 1.0;
    for (int p = region->first_row; p <= region->last_row; p++) {
        for (int q = region->first_column; q <= region->last_column; q++) {
            const size_t cell = cell_of(map, region, p, q);
            const int place = (p != HIT) + (q != HIT);
            map->area[cell] = fmin(map->area[cell] + drop->cap.area[place], 1.0);
            if (place == 0)
                continue;
            map->height[cell] += drop->height_scale * volume * drop->cap.volume[place];
            left -= drop->cap.volume[place];
        }
    }
    map->height[cell_of(map, region, HIT, HIT)] += drop->height_scale * volume * left;
}

/* Shares of the drop that the neighbours gain (eq. 11); returns their sum. */
static double neighbours_gains(const Region *region, const DropModel *drop, double difference[SIDE][SIDE],
                               double gain[SIDE][SIDE]) {
    double sum = 0.0;
    for (int p = region->first_row; p <= region->last_row; p++) {
        for (int q = region->first_column; q <= region->last_column; q++) {
            const double rise = difference[p][q];
            gain[p][q] = p == HIT && q == HIT ? 0.0 : (rise > 0.0 ? drop->mv_plus : drop->mv_minus) * rise;
            sum += gain[p][q];
        }
    }
    return sum;
}

/* Covered area of a neighbour after it has gained a height (eq. 13, and the guard). */
static double grown_area(const InkMap *map, size_t cell, const DropModel *drop, double rise, double gained) {
    const double area = map->area[cell], ink = map->height[cell] - map->substrate[cell];
    double grown = area + (rise > 0.0 ? drop->ma_plus : drop->ma_minus) * rise;
    if (drop->guard && rise > 0.0 && ink > 0.0 && gained > 0.0)
        grown = fmax(grown, area * (1.0 + gained / ink));
    return fmax(0.0, fmin(grown, 1.0));
}

void add_drop(const InkMap *map, size_t i, size_t j, const DropModel *drop, double volume) {
    const Region region = region_of(map, i, j);
    double difference[SIDE][SIDE], gain[SIDE][SIDE];
    if (height_differences(map, &region, difference) <= FLAT) {
        add_cap(map, &region, drop, volume);
        return;
    }
    double given = neighbours_gains(&region, drop, difference, gain);
    const double scale = drop->limit_gains && given > 1.0 ? 1.0 / given : 1.0;
    for (int p = region.first_row; p <= region.last_row; p++) {
        for (int q = region.first_column; q <= region.last_column; q++) {
            if (p == HIT && q == HIT)
                continue;
            const size_t cell = cell_of(map, &region, p, q);
            const double gained = drop->height_scale * volume * scale * gain[p][q];
            map->area[cell] = grown_area(map, cell, drop, difference[p][q], gained);
            map->height[cell] += gained;
        }
    }
    const size_t hit = cell_of(map, &region, HIT, HIT);
    map->height[hit] += drop->height_scale * volume * (1.0 - scale * given);
    map->area[hit] = 1.0;
}
