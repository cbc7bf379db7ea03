/* The robust fit of a scan in register: ink, and correction of the datum.
 *
 * Errors of readings have a t distribution with the variance of sensor and droplets as scale. The fit of a displaced
 * scan (displaced_fit.h) uses the normal equations of this one where there are no walls. */
#ifndef INKLOOP_REGISTER_FIT_H
#define INKLOOP_REGISTER_FIT_H

#include "scan_fit.h"

enum { SMOOTH_MAX = DATUM_TERMS + SHARES_MAX };

/* Copies a block of n * n values between matrices of different row length. */
static inline void copy_block(size_t n, const double *from, size_t from_stride, double *into, size_t stride) {
    for (size_t a = 0; a < n; a++)
        memcpy(into + a * stride, from + a * from_stride, n * sizeof *into);
}

/* The share, limited to the volumes that are believed. */
double share_within(double share);

/* The normal equations of terms of the datum, and changes of the shares. */
typedef struct {
    double matrix[SMOOTH_MAX * SMOOTH_MAX], side[SMOOTH_MAX];
} SmoothSums;

/* Normal equations of the cells not in `left_out`. misfit: factor of the variances in each class; NULL: 1. */
SmoothSums smooth_sums(const ScanEvidence *evidence, size_t shares, const uint8_t *left_out, const double *misfit);

/* Prior precision of datum and shares, in rows of `stride`. False if it is not definite. */
bool smooth_prior(const ScanEvidence *evidence, size_t shares, size_t stride, double *precision);

/* Stores datum and shares in the fit, from `first` on among `all` unknowns. */
void take_smooth(const double *x, const double *covariance, size_t first, size_t shares, size_t all, InkFit *fit);

/* Fits the scan in register. False if the equations are singular. */
bool fit_in_register(const ScanEvidence *evidence, FitRoom *room, InkFit *fit);

#endif
