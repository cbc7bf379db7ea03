/* The robust fit of a displaced scan: ink, datum, and where the sensor looks.
 *
 * The geometry shows at walls, so only these enter its Gauss-Newton steps. A displacement is believed if the odds speak
 * for it, and if it explains: a true one leaves residuals of one to two variances; droplets of another kind leave ten
 * and more whatever is fitted. Until that is clear readings at walls are weak: by the covariance of the geometry and by
 * its square. */
#ifndef INKLOOP_DISPLACED_FIT_H
#define INKLOOP_DISPLACED_FIT_H

#include "scan_fit.h"

/* Marks the walls by squares of the slopes of the prediction, and fits the displaced scan: the registration after it,
 * and `displaced`. `in_register` is what it is compared with. False if there is no memory. */
bool fit_displaced(const ScanEvidence *evidence, const double *slopes, const InkFit *in_register, FitRoom *room,
                   Registration *registration, InkFit *displaced);

/* What displaced scans left unexplained in the last scans: whether a displacement may be the truth. */
bool may_be_displaced(const Registration *registration);

#endif
