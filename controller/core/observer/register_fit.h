/* The robust fit of a scan in register: ink, and what is left of the datum.
 *
 * Errors of readings have a t distribution about what sensor and droplets explain. The fit of a displaced scan
 * (displaced_fit.h) uses the normal equations of this one where there are no walls. */
#ifndef INKLOOP_REGISTER_FIT_H
#define INKLOOP_REGISTER_FIT_H

#include "scan_fit.h"

enum { SMOOTH_MAX = DATUM_TERMS + SHARES_MAX };

/* Copies a block of n * n values between matrices with rows of such lengths. */
static inline void copy_block(size_t n, const double *from, size_t from_stride, double *into, size_t stride) {
    for (size_t a = 0; a < n; a++)
        memcpy(into + a * stride, from + a * from_stride, n * sizeof *into);
}

/* A share within the limits of what is believed. */
double share_within(double share);

/* The normal equations of terms of the datum, and changes of the shares. */
typedef struct {
    double matrix[SMOOTH_MAX * SMOOTH_MAX], side[SMOOTH_MAX];
} SmoothSums;

/* Those of the cells that are not left out. misfit: of the classes, by which their variances are larger than those of
 * droplets and sensor; NULL: they are not. */
SmoothSums smooth_sums(const ScanEvidence *evidence, size_t shares, const uint8_t *left_out, const double *misfit);

/* Prior precision of datum and shares, in rows of `stride`. False if it is not definite. */
bool smooth_prior(const ScanEvidence *evidence, size_t shares, size_t stride, double *precision);

/* Takes datum and shares into the fit, from `first` on among `all` unknowns. */
void take_smooth(const double *x, const double *covariance, size_t first, size_t shares, size_t all, InkFit *fit);

/* The scan in register. False if it cannot be solved for. */
bool fit_in_register(const ScanEvidence *evidence, FitRoom *room, InkFit *fit);

#endif
