/* Tests for scans that do not show the print, and for cells that get no more ink.
 *
 * Away from steep slopes each scan is compared with the prediction. If it fits badly, it is compared with other
 * explanations: nothing grew, the last scan again, the scan mirrored or turned. An explanation that fits far better
 * gains evidence; such a scan changes no map. Two in a row stop the print.
 *
 * The ledger needs no scan: with the least credible volume of a droplet it gives a lower bound of each height. A cell
 * whose bound is a layer above its target gets no more ink. Nor do the neighbours of a cell that is higher than its
 * droplets explain: their droplets flow to it. */
#ifndef INKLOOP_SCAN_DOUBTS_H
#define INKLOOP_SCAN_DOUBTS_H

#include "layer_prediction.h"

typedef struct {
    const ScanEvidence *evidence;
    const SurfaceEstimate *before;
    const double *measured; /* the raw scan, 0 where it is not valid [m] */
    double noise_variance;  /* variance of a reading before this scan [m^2] */
    int32_t layer;
    const LayerMaps *maps; /* maps whose memory is used as scratch */
} ScanDoubt;

/* Whether another explanation fits the scan far better; adds the evidence to `trust`. */
bool doubt_scan(const ScanDoubt *doubt, LoopTrust *trust);

/* Tests after a scan whether the learnt volume of the droplets is credible. */
void doubt_volume(const EstimatorOptions *options, const Knowledge *known, int32_t layer, LoopTrust *trust);

/* Counts the cells of the part that were not seen, are high, and are capped; into `estimate`. */
void look_at_part(const EstimatorOptions *options, const uint8_t *valid, SurfaceEstimate *estimate);

#endif
