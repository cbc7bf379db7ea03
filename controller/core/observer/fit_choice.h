/* Choice between the two fits of a scan, in register and displaced, and update of the estimate by it.
 *
 * The chosen fit updates the maps (map_update.h), ink, datum, variation of the droplets and shares of surprises. */
#ifndef INKLOOP_FIT_CHOICE_H
#define INKLOOP_FIT_CHOICE_H

#include "layer_prediction.h"

/* Updates the estimate by the scan of layer number `number`. False if the fit is singular, or there is no memory. */
bool take_scan(const ScanEvidence *evidence, const SurfaceEstimate *before, int32_t number, bool is_unknown,
               LayerMaps *maps, SurfaceEstimate *after);

#endif
