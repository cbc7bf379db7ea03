/* How much a droplet of each ink really adds, learnt from the layers of the print itself.
 *
 * Recursive estimation by instrumental variables, with the nominal ink as prior. The growth of a cell is linear in the
 * heights of the inks but its rates come from a surface that is known with an error; regressed on themselves they would
 * attribute it to the ink. The instrument is what the same droplets add on a flat surface, which no measurement enters;
 * for the volume alone, that they add anything. Where the patterns do not distinguish h1, h2 and h3 (full layers on a
 * flat surface) the prior keeps their proportion. Cells that grew far from what is usual - the first time the median,
 * then what was learnt - are left out with their neighbours: a dead nozzle lowers no volume. What is left of the error
 * of the surface: flow saturates, so that noise on a flat surface still lowers h1 in INK_FULL, by 4 % at 0.3 um after
 * one layer; it fades as the surface becomes known. */
#ifndef INKLOOP_INK_IDENTIFICATION_H
#define INKLOOP_INK_IDENTIFICATION_H

#include "droplet_increments.h"

/* What is learnt of each ink: its droplet volume; h1, h2 and h3 as far as the patterns distinguish them; nothing. */
enum { INK_SCALE = 1, INK_FULL = 2, INK_OFF = 3 };
enum { SHARES_MAX = INKS_MAX * ORDERS };

typedef struct {
    size_t inks;
    Ink nominal[INKS_MAX];
    int32_t model; /* INK_... */
} InkPrior;

/* Sums over the layers, recent ones more, of n learnt shares (n x n in C order): instrument times what a share adds
 * [m^2], covariance of instrument times growth [m^4], instrument times growth beyond the nominal [m^2]. */
typedef struct {
    double response[SHARES_MAX * SHARES_MAX], covariance[SHARES_MAX * SHARES_MAX], surplus[SHARES_MAX];
} InkEvidence;

/* Number of shares that are learnt. */
size_t ink_shares(const InkPrior *prior);

/* The inks that are likeliest after the evidence. */
void likeliest_inks(const InkPrior *prior, const InkEvidence *evidence, Ink ink[INKS_MAX]);

#endif
