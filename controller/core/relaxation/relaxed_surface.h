/* The surface after the horizon for droplets of any size, and the gradient of its smoothed objective by the adjoint of
 * the layer map.
 *
 * droplets: layers * nx * ny, in droplets of the first kind that a cell's choices allow; 0 where they allow none. A
 * positive part max(x, 0) is smoothed to (x + sqrt(x^2 + s^2)) / 2, the standard deviation to sqrt(variance + s^2); the
 * saturation of the layer map is not smoothed; its gradient at a kink is that of either side. */
#ifndef INKLOOP_RELAXED_SURFACE_H
#define INKLOOP_RELAXED_SURFACE_H

#include <stdbool.h>

#include "relaxed_flow.h"

typedef struct {
    const HorizonProblem *problem;
    size_t steps;  /* layers * passes */
    size_t framed; /* cells of a map with a frame of one cell, (nx + 2) * (ny + 2) */
    Footprint kind[KINDS_MAX];
    uint8_t *first;      /* layers * nx * ny: first kind allowed, or NO_KIND */
    double *height;      /* steps + 1 framed maps: before the first step, after each [m] */
    double *sensitivity; /* 2 framed maps: of the objective to the height after a step, and before it [1] */
    double count;        /* cells of the part */
    double ends_at;      /* by the stopwatch; infinite until the caller sets it */
    size_t threads;      /* 1 until the caller sets it; the bits do not depend on it */
    void *memory;
} RelaxedSurface;

/* Takes all memory at once: 8 (steps + 3) bytes per cell and a byte per layer. False if there is none. */
bool relaxed_open(RelaxedSurface *surface, const HorizonProblem *problem);
void relaxed_close(RelaxedSurface *surface);

/* Smoothed objective [m] of `droplets` in *value, and their surfaces in `height`. False, and neither is valid, if
 * `ends_at` came first. */
bool relaxed_value(RelaxedSurface *surface, const double *droplets, double smoothing, double *value);

/* Gradient of the value last computed, for the same droplets and smoothing [m per droplet]; 0 where no droplet is
 * allowed. False if `ends_at` came first. */
bool relaxed_gradient(RelaxedSurface *surface, const double *droplets, double smoothing, double *gradient);

#endif
