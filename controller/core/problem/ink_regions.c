#include "ink_regions.h"

#include <stdbool.h>

/* Without a branch on heights, which no processor could predict. */
static bool is_inside(const InkRegions *regions, size_t cell, double height) {
    const int64_t end = regions->offsets[cell + 1];
    bool inside = false;
    for (int64_t k = regions->offsets[cell]; k < end; k++)
        inside |= (regions->bottoms[k] <= height) & (height < regions->tops[k]);
    return inside;
}

uint16_t inks_for(const InkRegions *regions, size_t cell, double height, size_t ahead) {
    enum { FIRST = 1, SECOND = 2, EITHER = 3 };
    const double bottom = height + (double)ahead * regions->step;
    if (!regions->offsets)
        return FIRST;
    if (regions->test == REGION_EITHER) {
        const bool below = is_inside(regions, cell, bottom), above = is_inside(regions, cell, bottom + regions->step);
        return below != above ? EITHER : below ? FIRST : SECOND;
    }
    const double asked = bottom + (regions->test == REGION_MIDDLE ? regions->step / 2.0 : 0.0);
    return is_inside(regions, cell, asked) ? FIRST : SECOND;
}
