/* The surface of one liquid body at rest on the solid: mean curvature times surface tension is the same everywhere
 * (Young-Laplace; Hume and Rosen 2018, eq. 3 and 5), its edge stays on the footprint, its volume is given (eq. 4), and
 * it never cuts into the solid.
 *
 * Unknown is the liquid's depth w at each node, in spacings. The flux through an arm, gx / sqrt(1 + gx^2 + gy^2), or gx
 * in the linear form, is taken as the mean over the adjacent quarters of squares, with the slopes along the arms; the
 * flux out of a node equals the pressure, except on the solid. Away from the edge that is the least area of the surface
 * under sum(w) = volume and w >= 0. Newton's method, each step with one banded factorisation and two right-hand sides,
 * and a set of nodes pinned to the solid. An arm that the edge cuts counts with its own length and the width of a
 * square (Gibou, Fedkiw, Cheng, Kang 2002: symmetric, of second order). */
#ifndef INKLOOP_LIQUID_BODY_H
#define INKLOOP_LIQUID_BODY_H

#include "wetted_nodes.h"

typedef enum { LINEAR = 1, NONLINEAR } SurfaceForm;

typedef struct {
    WettedNodes wet;
    double *depth;                      /* w of each node, in spacings */
    double *force;                      /* flux out of each node */
    double *step, *response, *previous; /* without pressure, per unit of pressure; depths before the step */
    bool *is_pinned;
    double *matrix;  /* of the second slopes, a band */
    double pressure; /* of the liquid over surface tension, times the spacing */
} LiquidBody;

/* Solves for `depth`; its sum is `volume`, in cubed spacings, to rounding. False if the form has no solution here: the
 * depths are then of no use. */
bool settle(LiquidBody *body, SurfaceForm form, double volume);

#endif
