#include "relaxed_surface.h"

/* Smoothed objective of relaxed droplets in *value [m], and its gradient (layers * nx * ny) [m per droplet]; false: out
 * of memory. */
bool smoothed_objective(const HorizonProblem *problem, const double *droplets, double smoothing, double *value,
                        double *gradient) {
    RelaxedSurface surface;
    const bool is_open = relaxed_open(&surface, problem);
    if (is_open) {
        (void)relaxed_value(&surface, droplets, smoothing, value);
        (void)relaxed_gradient(&surface, droplets, smoothing, gradient);
    }
    relaxed_close(&surface);
    return is_open;
}
