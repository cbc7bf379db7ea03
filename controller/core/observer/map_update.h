/* Update of the maps by a scan, cell by cell: heights, their variances, surprises, and evidence of dead cells.
 *
 * A reading is weighted by its variance against that of the prediction. A residual beyond droplets and sensor is a
 * surprise: the first time it counts as an error of the sensor and gets hardly any weight; if it repeats, it counts as
 * a change of the cell. The residuals of a displaced scan are interpolated at the place of each cell on the scan. */
#ifndef INKLOOP_MAP_UPDATE_H
#define INKLOOP_MAP_UPDATE_H

#include "displaced_fit.h"

typedef struct {
    const ScanEvidence *evidence;
    const SurfaceEstimate *before;
    const InkFit *fit;      /* fit that predicts the heights */
    const double *geometry; /* covariance of the geometry for readings at walls; NULL: none */
    const uint8_t *walls;
    const double *spread_slope; /* derivative of the prediction with respect to the spot */
    const double *full_own;     /* height that each cell's droplet would leave on it, dead nozzles included [m] */
    double extra[CLASSES];      /* process noise in addition to that of droplets, in native variances */
    bool is_robust;
    bool is_telling; /* whether the scan shows dead cells and surprises */
    double *scratch[3];
    SurfaceEstimate *after;
} MapUpdate;

/* Counts of an update. */
typedef struct {
    size_t seen, vanished, lasted; /* readings; surprises of the scan before that vanished, and that lasted */
} Surprises;

/* Update by a scan in register, and by a scan displaced by the geometry `g`. */
Surprises update_in_register(const MapUpdate *update);
Surprises update_displaced(const MapUpdate *update, const double g[GEOMETRY], const double *averaged);

/* Update without a scan: heights are the predicted ones; reads `evidence`, `before` and `after`. */
void live_on_prediction(const MapUpdate *update);

#endif
