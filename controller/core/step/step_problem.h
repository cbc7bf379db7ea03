/* The decision problem of the layers that follow a scan, in the form that the search takes. */
#ifndef INKLOOP_STEP_PROBLEM_H
#define INKLOOP_STEP_PROBLEM_H

#include "horizon_problem.h"
#include "step_options.h"

/* The surface that a plan begins on; maps of nx * ny. */
typedef struct {
    const double *height;   /* [m] */
    const double *variance; /* of its error [m^2] */
    const uint8_t *dead;    /* cells whose droplets bring nothing: tried again in some layers */
    const uint8_t *capped;  /* cells that are given no more ink */
    Ink ink[INKS_MAX];      /* these three as in EstimateFigures */
    double droplet_std;
    int32_t is_foreign;
} SurfaceToPlan;

/* Memory that a problem points to: maps of nx * ny, and choices of horizon * nx * ny. */
typedef struct {
    double *ceiling, *weight;
    uint16_t *choices;
} ProblemMaps;

/* The problem of the layers that follow layer number `layer`; it points into the surface, into the options and into the
 * maps, of which it fills those that it needs. */
HorizonProblem layer_problem(const LayerStep *step, const SurfaceToPlan *surface, int32_t layer,
                             const ProblemMaps *maps);

/* The cells that count as dead in an estimate. */
void mark_dead(const SurfaceEstimate *estimate, size_t cells, uint8_t *dead);

#endif
