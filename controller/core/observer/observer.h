/* From scans to the planner's starting point: the surface, how much ink a droplet really adds, and whether the scans
 * show what was printed.
 *
 * A scan after a layer goes through these steps:
 *  1. the layer map predicts the surface from the last estimate (predicted_scan.c); droplets add to its variance;
 *  2. ground gives the datum of the scan (scan_datum.c), and the noise of its readings;
 *  3. other explanations of the whole scan are compared with it (scan_doubts.c); if one fits far better, the maps live
 *     on the prediction;
 *  4. ink and geometry are fitted, in register and displaced, and one of them is believed (register_fit.c,
 *     displaced_fit.c, fit_choice.c);
 *  5. each cell takes a share of what its reading is off by (map_update.c); what is off tells how much droplets vary;
 *  6. the ledger counts the droplets, without any scan.
 * The bits of an estimate do not depend on the threads. */
#ifndef INKLOOP_OBSERVER_H
#define INKLOOP_OBSERVER_H

#include "surface_estimate.h"

/* The surface of layer number `layer`, on which the print begins; a cell that was not measured counts as bare
 * substrate, height 0. False if less than 2 % of the grid was measured: that is no scan. */
bool estimate_first(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                    SurfaceEstimate *estimate);

/* Estimate after the scan `measured` [m], where `valid`, of layer number `number`, printed on the surface estimated
 * `before`. is_unknown: the layer was abandoned at an unknown place: each cell grew by between nothing and the whole
 * layer, and nothing is learnt. False if there is no memory. `before` and `after` have separate maps. */
bool estimate_next(const EstimatorOptions *options, const SurfaceEstimate *before, const JettedLayer *layer,
                   int32_t number, bool is_unknown, const double *measured, const uint8_t *valid,
                   SurfaceEstimate *after);

/* Clears the distrust after a person has looked: the print resumes, and the next scan is accepted unchecked. If the one
 * after it fits another explanation far better, the print is stopped again. */
void trust_again(SurfaceEstimate *estimate, size_t cells);

#endif
