/* Error of a surface against its target, over the cells of the part. */
#ifndef INKLOOP_SURFACE_ERROR_H
#define INKLOOP_SURFACE_ERROR_H

#include <stdbool.h>
#include <stddef.h>

/* Target minus height [m]: mean, mean absolute value, standard deviation (population). All 0 for no cell. */
typedef struct {
    double mean, mean_absolute, deviation;
} SurfaceError;

SurfaceError surface_error(const double *height, const double *target, const bool *part, size_t cells);

#endif
