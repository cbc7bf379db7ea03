/* What the flips of many cells beside each other cost, in single precision: for bounds.
 *
 * Differences of heights are taken in double precision and rounded once. An error counts up to 2 V, V being what a
 * droplet adds in all: beyond that its cost is linear, whatever a droplet adds. So a cost is at most 3 V times the
 * slope and a flip adds up 18 of them, with less than 24 roundings of 2^-24 on the way of each: together FLIP_ROUNDING.
 */
#ifndef INKLOOP_FLIP_COSTS_H
#define INKLOOP_FLIP_COSTS_H

#include "plan_surface.h"
#include "tile.h"

enum { FLIPS_MAX = TILE }; /* read together */

static const double FLIP_ROUNDING = 1e-4; /* of what a droplet's volume costs where its slope changes */

/* What counts in costs; lengths in metres. */
typedef struct {
    float volume, spread[2], slope[2]; /* of the droplet */
    float reach;                       /* of errors: more count as this */
    float overshoot, upward, ceiling_cost;
    float chance, least_chance;
    float most; /* of what a flip costs: more is of no use */
} FlipPrices;

/* For a surface of one step and one kind of droplets. */
FlipPrices flip_prices(const PlanSurface *surface, float most);

/* Sets least[k] for so many cells of a row from `cell` on: what the flip costs, within FLIP_ROUNDING. */
void flip_costs_read(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count, float *least);

#endif
