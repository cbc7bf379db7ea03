/* The robust fit of a displaced scan: ink, datum, and geometry.
 *
 * The geometry shows at walls, so only these enter its Gauss-Newton steps. A displacement is believed if the odds
 * favour it and its residuals are small: a true one leaves one to two variances; droplets that the model does not
 * describe leave ten and more in any fit. Until this is decided readings at walls are down-weighted by the covariance
 * and the square of the geometry. */
#ifndef INKLOOP_DISPLACED_FIT_H
#define INKLOOP_DISPLACED_FIT_H

#include "scan_fit.h"

/* Marks the walls by squares of the slopes of the prediction, and fits the displaced scan: the registration after it,
 * and `displaced`. It is compared with the fit `in_register`. False if there is no memory. */
bool fit_displaced(const ScanEvidence *evidence, const double *slopes, const InkFit *in_register, FitRoom *room,
                   Registration *registration, InkFit *displaced);

/* Whether a displacement can be the truth, by the residuals that displaced fits of the last scans left. */
bool may_be_displaced(const Registration *registration);

#endif
