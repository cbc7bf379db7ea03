/* The surface that a pattern gives, kept up to date while single droplets are put and taken away.
 *
 * Over one layer the surface is linear in the pattern: a droplet adds the same nine shares whatever its neighbours do.
 * The shares are computed once; putting a droplet costs nine additions. */
#ifndef INKLOOP_LAYER_SURFACE_H
#define INKLOOP_LAYER_SURFACE_H

#include <stdbool.h>

#include "inkloop_core.h"
#include "objective.h"

typedef struct {
    size_t nx, ny;
    Weighting weighting;
    double droplet_worth; /* what one cell nearer by the height of a droplet is worth in the objective [m] */
    double least_gain;    /* a change of the objective counts as a gain below minus this [m] */
    const uint8_t *allowed;
    ptrdiff_t offset[FOOTPRINT]; /* from a cell to its 3x3 cells, in the arrays with a frame */
    double *share;               /* nx * ny * 9: what a droplet adds to the part's cells [m]; 0 outside the part */
    double *error;               /* height minus target; with a frame of one cell, so that no edge need be checked */
    double *height;              /* height minus a reference near its mean; with the same frame */
    uint8_t *occupied;           /* nx * ny: a droplet is there */
    Sums sums;
    void *memory;
} LayerSurface;

/* Takes all memory of the search at once. False if there is none. */
bool surface_open(LayerSurface *surface, const LayerProblem *problem, const int32_t *pattern);
void surface_close(LayerSurface *surface);

/* What putting (or taking) the droplet at a cell adds to the sums. */
Sums surface_flip_change(const LayerSurface *surface, size_t cell);

/* Puts or takes the droplet at a cell; `change` from surface_flip_change. */
void surface_flip(LayerSurface *surface, size_t cell, const Sums *change);

/* Surface and sums of the present pattern from scratch, free of what many flips have left in them. */
void surface_evaluate(LayerSurface *surface, const LayerProblem *problem);

/* Writes 0 or 1 + material of every cell. */
void surface_pattern(const LayerSurface *surface, const LayerProblem *problem, int32_t *pattern);

#endif
