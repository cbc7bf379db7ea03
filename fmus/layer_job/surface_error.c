#include "surface_error.h"

#include <math.h>

SurfaceError surface_error(const double *height, const double *target, const bool *part, size_t cells) {
    SurfaceError found = {0.0, 0.0, 0.0};
    double count = 0.0;
    for (size_t cell = 0; cell < cells; cell++) {
        if (part[cell]) {
            found.mean += target[cell] - height[cell];
            found.mean_absolute += fabs(target[cell] - height[cell]);
            count += 1.0;
        }
    }
    if (count == 0.0)
        return found;
    found.mean /= count;
    found.mean_absolute /= count;
    for (size_t cell = 0; cell < cells; cell++) {
        const double apart = target[cell] - height[cell] - found.mean;
        found.deviation += part[cell] ? apart * apart : 0.0;
    }
    found.deviation = sqrt(found.deviation / count);
    return found;
}
