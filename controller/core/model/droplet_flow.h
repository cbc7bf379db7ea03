/* Flow from droplets to neighbouring cells (the layer map of layer_map.h, on the lattice of lattice.h). */
#ifndef INKLOOP_DROPLET_FLOW_H
#define INKLOOP_DROPLET_FLOW_H

#include "lattice.h"
#include "layer_map.h"

enum { SIDE, CORNER };

typedef struct {
    double volume;    /* height added over all nine cells: h1 + 4 h2 + 4 h3 [m] */
    double spread[2]; /* largest share of a side and of a corner neighbour: h2 and h3 [m] */
    double slope[2];  /* decrease of that share per metre that the neighbour lies above the cell hit */
    /* Spread and slope as rows of five cells with the droplet in the middle; 0 there and beyond its neighbours. */
    double spread_lanes[3][5], slope_lanes[3][5];
} Droplet;

static inline Droplet droplet_of(const Ink *ink) {
    const double side = on_lattice(ink->h2), corner = on_lattice(ink->h3);
    const double side_slope = ink->h2 / (ink->h1 + ink->h2), corner_slope = ink->h3 / (ink->h1 + ink->h3);
    return (Droplet){on_lattice(ink->h1) + 4.0 * side + 4.0 * corner,
                     {side, corner},
                     {side_slope, corner_slope},
                     {{0.0, corner, side, corner, 0.0}, {0.0, side, 0.0, side, 0.0}, {0.0, corner, side, corner, 0.0}},
                     {{0.0, corner_slope, side_slope, corner_slope, 0.0},
                      {0.0, side_slope, 0.0, side_slope, 0.0},
                      {0.0, corner_slope, side_slope, corner_slope, 0.0}}};
}

static inline double between(double low, double value, double high) {
    const double raised = value > low ? value : low;
    return raised < high ? raised : high;
}

/* Height that a neighbour takes when the cell hit lies `rise` above it; 0 without a droplet, whose spread is 0. */
static inline double flow(double spread, double slope, double rise) {
    return between(0.0, spread + on_lattice(slope * rise), spread);
}

#endif
