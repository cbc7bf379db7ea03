#include "small_algebra.h"

#include <math.h>

static const double SINGULAR = 1e-12; /* share of a diagonal entry below which its remainder is rounding (assumed) */

bool solve_definite(size_t n, const double *a, double *b) {
    double l[ENTRIES_MAX] = {0.0};
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j <= i; j++) {
            double left = a[i * n + j];
            for (size_t k = 0; k < j; k++)
                left -= l[i * n + k] * l[j * n + k];
            if (i == j && !(left > SINGULAR * a[i * n + i]))
                return false;
            l[i * n + j] = i == j ? sqrt(left) : left / l[j * n + j];
        }
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < i; k++)
            b[i] -= l[i * n + k] * b[k];
        b[i] /= l[i * n + i];
    }
    for (size_t i = n; i-- > 0;) {
        for (size_t k = i + 1; k < n; k++)
            b[i] -= l[k * n + i] * b[k];
        b[i] /= l[i * n + i];
    }
    return true;
}

bool invert_definite(size_t n, const double *matrix, double *inverse) {
    for (size_t k = 0; k < n; k++) {
        double column[UNKNOWNS_MAX] = {0.0};
        column[k] = 1.0;
        if (!solve_definite(n, matrix, column))
            return false;
        for (size_t i = 0; i < n; i++)
            inverse[i * n + k] = column[i];
    }
    return true;
}
