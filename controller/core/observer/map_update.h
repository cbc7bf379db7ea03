/* What a scan changes in the maps, cell by cell: heights, their variances, surprises, and evidence of dead cells.
 *
 * A reading counts by its variance against that of the prediction. One that surprises beyond droplets and sensor is
 * taken for the sensor's and hardly counts; where it is off by the same again, it is the cell's. A displaced scan is
 * read back: what its readings are off by is interpolated where each cell lies on the scan. */
#ifndef INKLOOP_MAP_UPDATE_H
#define INKLOOP_MAP_UPDATE_H

#include "displaced_fit.h"

typedef struct {
    const ScanEvidence *evidence;
    const SurfaceEstimate *before;
    const InkFit *fit;      /* that the heights are predicted by */
    const double *geometry; /* covariance that readings at walls suffer from; NULL: none */
    const uint8_t *walls;
    const double *spread_slope; /* of the prediction */
    const double *full_own;     /* what the droplets of cells would leave on them, dead ones too [m] */
    double extra[CLASSES];      /* process noise beyond that of droplets, in native variances */
    bool is_robust;
    bool is_telling; /* of dead cells, surprises */
    double *scratch[3];
    SurfaceEstimate *after;
} MapUpdate;

/* Counts of an update. */
typedef struct {
    size_t seen, vanished, lasted; /* readings; surprises of the scan before that were the sensor's, and the cells' */
} Surprises;

/* A scan in register, and a displaced one by the geometry `g`. */
Surprises update_in_register(const MapUpdate *update);
Surprises update_displaced(const MapUpdate *update, const double g[GEOMETRY], const double *averaged);

/* A layer without a scan that counts: heights are what is predicted; of `evidence`, `before` and `after`. */
void live_on_prediction(const MapUpdate *update);

#endif
