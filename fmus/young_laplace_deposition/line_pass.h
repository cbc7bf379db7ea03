/* One pass: runs of neighbouring droplets of a line flow together into bodies, all bodies rest on the surface before
 * the pass, independently of each other (Hume and Rosen 2018). Lines run along x, one per cell along y. */
#ifndef INKLOOP_LINE_PASS_H
#define INKLOOP_LINE_PASS_H

#include "liquid_body.h"

typedef struct {
    double droplet_volume; /* volume of one drop [m3] */
    double contact_angle;  /* [rad] */
    SurfaceForm form;
} Liquid;

/* Memory of the present body, and the surface before a pass. */
typedef struct {
    LiquidBody body;
    double *before;
    Place *ends, *hull;
} PassMemory;

/* Bytes that passes over a surface of this size need; if `memory` is not NULL, their places in it. */
size_t place_pass_memory(const FineSurface *surface, void *memory, PassMemory *places);

/* Report of a pass. */
typedef struct {
    int32_t fallbacks; /* bodies without a nonlinear solution, solved in the linear form */
    double lost;       /* volume beyond the grid of cells [m3] */
} PassReport;

/* Prints the lines `line`, `line` + `every`, ... onto the surface. `drops` (nx, ny): volume of each droplet in nominal
 * drops, 0 for none; a droplet's cap_radius is at most WIDEST_SPREAD pitches. */
PassReport print_pass(const FineSurface *surface, const Liquid *liquid, const double *drops, size_t line, size_t every,
                      PassMemory *memory);

#endif
