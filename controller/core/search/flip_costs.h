/* Costs of the flips of many adjacent cells, in single precision: for bounds.
 *
 * Differences of heights are taken in double precision and rounded once. An error is clipped to 2 V, V being the height
 * a droplet adds in all: beyond that its cost is linear. So a cost is at most 3 V times the slope and a flip adds up 18
 * of them, with less than 24 roundings of 2^-24 on the way of each: together FLIP_ROUNDING. */
#ifndef INKLOOP_FLIP_COSTS_H
#define INKLOOP_FLIP_COSTS_H

#include "plan_surface.h"
#include "tile.h"

enum { FLIPS_MAX = TILE }; /* read together */

/* rounding of a cost, as a share of the cost of a droplet's volume where its slope changes */
static const double FLIP_ROUNDING = 1e-4;

/* Constants of the costs; lengths in metres. */
typedef struct {
    float volume, spread[2], slope[2]; /* volume, largest shares and slopes of the droplet */
    float reach;                       /* limit of errors: larger ones count as this */
    float overshoot, upward, ceiling_cost;
    float chance, least_chance;
    float most; /* limit of costs: larger ones are of no use */
} FlipPrices;

/* The constants for a surface of one step and one kind of droplets. */
FlipPrices flip_prices(const PlanSurface *surface, float most);

/* Sets least[k] for so many cells of a row from `cell` on: the cost of the flip, within FLIP_ROUNDING. */
void flip_costs_read(const FlipPrices *prices, const PlanSurface *surface, size_t cell, size_t count, float *least);

#endif
