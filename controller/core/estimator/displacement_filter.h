/* The filter under the registration of scans: which displacement makes a predicted scan likeliest.
 *
 * An iterated extended Kalman filter on six unknowns, with robust weights of the readings. It decides nothing:
 * scan_registration.c does. */
#ifndef INKLOOP_DISPLACEMENT_FILTER_H
#define INKLOOP_DISPLACEMENT_FILTER_H

#include "scan_linearisation.h"

typedef struct {
    double estimate[DISPLACEMENTS];                   /* of the last scan [cells, cells, cells^2] */
    double covariance[DISPLACEMENTS * DISPLACEMENTS]; /* of its error */
    double applied[DISPLACEMENTS];                    /* what the heights stand corrected for; 0 before the evidence */
    double steps_variance;                            /* learnt: of the shift from scan to scan [cells^2] */
    double misfit;                                    /* learnt: variance of a reading per squared curvature [1] */
    double far_product, far_information; /* of readings beyond the reach of droplets: what a spot spreads there [1], and
                                            how much it would for each unit of its spread [1 per cells^4] */
    int64_t scans;                       /* that it is learnt from */
    int32_t has_shift;                   /* whether scans are corrected for a shift, */
    int32_t has_wide_spot;               /* and for a spot */
} Registration;

/* The likeliest unknowns and their covariance: by an iterated extended Kalman filter, or by one linear step from what
 * is applied. Between cells a displaced scan averages noise, which makes any displacement likelier than none; the
 * linear step is free of that. False if they cannot be solved for. */
bool likeliest_displacement(const ScanEvidence *evidence, const Registration *registration, bool is_iterated,
                            Room *room, double x[UNKNOWNS], double *covariance);

#endif
