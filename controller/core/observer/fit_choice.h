/* Which fit of a scan is believed, in register or displaced, and what the estimate takes from it.
 *
 * It updates the maps (map_update.h); ink, datum, variation of the droplets and shares of surprises are learnt by it.
 */
#ifndef INKLOOP_FIT_CHOICE_H
#define INKLOOP_FIT_CHOICE_H

#include "layer_prediction.h"

/* Takes the scan of layer number `number`. False if it cannot be solved for, or there is no memory. */
bool take_scan(const ScanEvidence *evidence, const SurfaceEstimate *before, int32_t number, bool is_unknown,
               LayerMaps *maps, SurfaceEstimate *after);

#endif
