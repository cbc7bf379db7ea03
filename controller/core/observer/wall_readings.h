/* Readings at walls, where the geometry of a displaced scan shows, and what a fit leaves of them.
 *
 * The unknowns are geometry, terms of the datum, and shares of the ink. */
#ifndef INKLOOP_WALL_READINGS_H
#define INKLOOP_WALL_READINGS_H

#include "scan_fit.h"

enum { DATUM = GEOMETRY, SHARE = DATUM + DATUM_TERMS, FITTED = SHARE + SHARES_MAX };

/* A reading, and how it goes with the unknowns. */
typedef struct {
    size_t cell;
    double u, w, column[FITTED], rest, variance, slopes;
    double squares; /* of its droplets, as in DropletIncrements */
    size_t class;
} Wall;

typedef struct {
    const ScanEvidence *evidence;
    FitRoom *room;
    size_t shares, count;
    double spread, share[SHARES_MAX]; /* spot [cells^2] and ink that the averaged prediction has */
    double step;                      /* half a step of the difference quotients that slopes are [cells] */
    Wall *walls;                      /* memory that is given back by give_maps */
    double *values;                   /* for medians */
} WallFit;

/* Marks the cells that a geometry of such covariance may move: those near steep ones, by squares of the slopes; all
 * cells where scans are displaced. */
void mark_walls(const ScanEvidence *evidence, const double *slopes, const double *covariance, FitRoom *room);

/* Finds the readings on marked cells. False if there is no memory. */
bool collect_walls(WallFit *fit);

/* Averages the prediction with the ink of the unknowns over their spot. */
void average_walls(const double *x, WallFit *fit);

/* Looks at the readings by the unknowns. */
void look_at_walls(const double *x, WallFit *fit);

/* Median error of steep readings in variances, at least 1: a fit far from its end gives them less weight. */
double heat_of(const WallFit *fit, const double *covariance);

/* Residuals, in variances, the largest of a group of walls; those of the classes, and what droplets are learnt from, go
 * into the fit. */
double misfit_of(const WallFit *fit, bool is_displaced, InkFit *displaced);

/* By how much likelier the readings are displaced than in register, with its datum and shares by one of the fits, as a
 * logarithm. */
double likelihood_gained(const WallFit *fit, const InkFit *in_register);

#endif
