/* Flow of droplets of any size to their neighbours in one step, and its adjoint: sensitivities to the droplets and to
 * the surface before the step. Maps have a frame of one cell.
 *
 * Each cell gathers its own terms, so rows are independent of each other: several threads add the same terms in the
 * same order as one. */
#ifndef INKLOOP_RELAXED_FLOW_H
#define INKLOOP_RELAXED_FLOW_H

#include <stdbool.h>

#include "horizon_problem.h"

typedef struct {
    double h1;           /* [m] */
    double spread[2];    /* largest share of a neighbour at a side or a corner [m] */
    double steepness[2]; /* steepness of the saturation: 1 / (h1 + spread) [1/m] */
} Footprint;

/* Maps of the grid belong to the layer of the step. `before` has a frame at minus infinity, which takes every share in
 * full and is never raised: an open edge. */
typedef struct {
    const HorizonProblem *problem;
    const Footprint *kind;
    const uint8_t *first;   /* first kind allowed, or NO_KIND */
    const double *droplets; /* droplets of that kind */
    int32_t colour;         /* `cell_colour` of the cells that are jetted, or COLOUR_ALL */
    double ends_at;         /* by the stopwatch */
    const double *before;   /* framed [m] */
} RelaxedStep;

/* The surface after the step, rows `top` to `bottom` of the grid, bottom excluded. False if `ends_at` came first. */
bool jet_rows(const RelaxedStep *step, size_t top, size_t bottom, double *after);

/* Sensitivities to the surface before the step and to the droplets of the step, 0 where none is allowed, from the one
 * to the surface after it, whose frame is 0. Rows and result as in `jet_rows`. */
bool trace_rows(const RelaxedStep *step, size_t top, size_t bottom, const double *later, double *earlier,
                double *gradient);

#endif
