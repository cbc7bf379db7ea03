/* Whole scans that do not show what was printed, and cells that get no more ink.
 *
 * Each scan is compared, away from steep slopes, with the prediction as it was read, and where that fits badly with
 * other explanations: nothing grew, the last scan again, the scan mirrored or turned. One that fits far better collects
 * evidence; such a scan changes no map. Twice in a row stops the print.
 *
 * The ledger needs no scan: by the least volume that is believed of droplets it says how high a cell must stand. One
 * that is to stand above its target by a layer gets no more ink. Nor do the neighbours of one that stands higher than
 * its droplets explain: theirs run to it. */
#ifndef INKLOOP_SCAN_DOUBTS_H
#define INKLOOP_SCAN_DOUBTS_H

#include "layer_prediction.h"

typedef struct {
    const ScanEvidence *evidence;
    const SurfaceEstimate *before;
    const double *measured; /* the scan as it came, but 0 where it is not valid [m] */
    double noise_variance;  /* of a reading, as it was known before [m^2] */
    int32_t layer;
    const LayerMaps *maps; /* whose room is used */
} ScanDoubt;

/* Whether another explanation fits far better; adds the evidence to `trust`. */
bool doubt_scan(const ScanDoubt *doubt, LoopTrust *trust);

/* Whether the volume of the droplets is beyond belief, after a scan. */
void doubt_volume(const EstimatorOptions *options, const Knowledge *known, int32_t layer, LoopTrust *trust);

/* Cells of the part: not seen, high, and capped; in `estimate`. */
void look_at_part(const EstimatorOptions *options, const uint8_t *valid, SurfaceEstimate *estimate);

#endif
