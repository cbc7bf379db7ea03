/* How much ink a cell may be given: no more than what a print without scans would have put there.
 *
 * Full layers up to the target, counted by the nominal ink, build the highest that an open loop reaches; a layer in
 * reserve and what droplets vary by are added. A cell that asks for more is capped: by the droplets that it was given
 * (dead reckoning with the ink that the whole part has shown, no reading of the cell enters), it stands there already,
 * so a scan that shows less is wrong, or droplets come to rest elsewhere. So are cells next to one that stands higher
 * than droplets explain: their droplets run to it. */
#ifndef INKLOOP_INK_LIMIT_H
#define INKLOOP_INK_LIMIT_H

#include "droplet_increments.h"

typedef struct {
    size_t nx, ny;
    const uint8_t *part;
    const double *target; /* for the whole print [m] */
    double layer;         /* height of a nominal full layer of the largest droplets [m] */
    double droplet_std;   /* what a droplet varies by on a cell and its neighbours, in quadrature [m] */
    double own;           /* the most that one droplet leaves on its cell [m] */
} InkLimit;

/* Height that the droplets given to a cell may add up to [m]. */
double ink_limit_at(const InkLimit *limit, size_t cell);

/* How far cells stand above their target and above what their droplets explain. */
typedef struct {
    size_t count;   /* of the cells of the part that do so beyond chance */
    double highest; /* the most that one does [m]; 0: none does */
    size_t cell;    /* that one */
} HighCells;

/* Marks the `capped` cells of a surface `height` [m] that by dead reckoning is `reckoned` [m], and finds the high ones;
 * returns how many are capped. */
size_t mark_capped(const InkLimit *limit, const double *height, const double *reckoned, uint8_t *capped,
                   HighCells *high);

#endif
