/* Readings at walls, which determine the geometry of a displaced scan, and their residuals.
 *
 * The unknowns are geometry, terms of the datum, and shares of the ink. */
#ifndef INKLOOP_WALL_READINGS_H
#define INKLOOP_WALL_READINGS_H

#include "scan_fit.h"

enum { DATUM = GEOMETRY, SHARE = DATUM + DATUM_TERMS, FITTED = SHARE + SHARES_MAX };

/* A reading, and its derivatives with respect to the unknowns. */
typedef struct {
    size_t cell;
    double u, w, column[FITTED], rest, variance, slopes;
    double squares; /* sum of the squares of its droplets' increments [m^2] */
    size_t class;
} Wall;

typedef struct {
    const ScanEvidence *evidence;
    FitRoom *room;
    size_t shares, count;
    double spread, share[SHARES_MAX]; /* spot [cells^2] and ink of the averaged prediction */
    double step;                      /* half a step of the difference quotients [cells] */
    Wall *walls;                      /* memory released by give_maps */
    double *values;                   /* for medians */
} WallFit;

/* Marks the cells that a geometry of this covariance may move: those near steep cells, by squares of the slopes; all
 * cells if scans are displaced. */
void mark_walls(const ScanEvidence *evidence, const double *slopes, const double *covariance, FitRoom *room);

/* Finds the readings on marked cells. False if there is no memory. */
bool collect_walls(WallFit *fit);

/* Averages the prediction with the ink of the unknowns over their spot. */
void average_walls(const double *x, WallFit *fit);

/* Residuals and derivatives of the readings for the unknowns x. */
void look_at_walls(const double *x, WallFit *fit);

/* Median squared error of steep readings in variances, at least 1: divides the weights while the fit is far from its
 * end. */
double heat_of(const WallFit *fit, const double *covariance);

/* Residuals in variances, the largest over groups of walls; stores those of the classes, and those that droplets are
 * learnt from, in the fit. */
double misfit_of(const WallFit *fit, bool is_displaced, InkFit *displaced);

/* Log likelihood ratio of the readings, displaced against in register, with datum and shares of one of the fits. */
double likelihood_gained(const WallFit *fit, const InkFit *in_register);

#endif
