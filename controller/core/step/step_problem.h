/* The decision problem of the layers that follow a scan, in the form that the search takes. */
#ifndef INKLOOP_STEP_PROBLEM_H
#define INKLOOP_STEP_PROBLEM_H

#include "horizon_problem.h"
#include "step_options.h"

/* Estimated surface from which a plan begins; maps of nx * ny. */
typedef struct {
    const double *height;   /* [m] */
    const double *variance; /* variance of the height's error [m^2] */
    const uint8_t *dead;    /* cells whose droplets fail: tried again in some layers */
    const uint8_t *capped;  /* cells that get no more ink */
    Ink ink[INKS_MAX];      /* these three as in EstimateFigures */
    double droplet_std;
    int32_t is_foreign;
} SurfaceToPlan;

/* Memory of a problem: maps of nx * ny, and choices of horizon * nx * ny. */
typedef struct {
    double *ceiling, *weight;
    uint16_t *choices;
} ProblemMaps;

/* The problem of the layers that follow layer number `layer`; it refers to the surface, to the options and to the maps,
 * of which it fills those that it needs. */
HorizonProblem layer_problem(const LayerStep *step, const SurfaceToPlan *surface, int32_t layer,
                             const ProblemMaps *maps);

/* The cells that count as dead in an estimate. */
void mark_dead(const SurfaceEstimate *estimate, size_t cells, uint8_t *dead);

#endif
