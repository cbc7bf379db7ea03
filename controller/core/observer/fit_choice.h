/* Which fit of a scan is believed, in register or displaced, and what the estimate takes from it.
 *
 * The maps are updated (map_update.h), and ink, datum, variation of the droplets, and whether surprises last are
 * learnt.
 */
#ifndef INKLOOP_FIT_CHOICE_H
#define INKLOOP_FIT_CHOICE_H

#include "layer_prediction.h"

/* Of the scan of layer number `number`. False if there is no memory. */
bool take_scan(const ScanEvidence *evidence, const SurfaceEstimate *before, int32_t number, bool is_unknown,
               LayerMaps *maps, SurfaceEstimate *after);

#endif
