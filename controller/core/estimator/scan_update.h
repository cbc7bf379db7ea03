/* What a scan in register changes in the estimate, cell by cell. */
#ifndef INKLOOP_SCAN_UPDATE_H
#define INKLOOP_SCAN_UPDATE_H

#include "displacement_response.h"
#include "row_ranges.h"
#include "surface_estimate.h"

/* A layer that was scanned, what was known before, and maps for what is known after. The threads share it. */
typedef struct {
    const EstimatorOptions *options;
    const SurfaceEstimate *before;
    const JettedLayer *layer;
    const RegisteredScan *registered;
    const PredictionVariance *variance;
    const DropletIncrements *increments; /* overwritten by find_dead */
    const Ink *ink;                      /* whose proportions are expected of the growth */
    double *predicted;                   /* for correct_cells and look_at_growth: the surface after the layer [m] */
    uint8_t *marks;                      /* two maps */
    SurfaceEstimate *after;
    bool is_dry; /* the head */
    size_t part_cells[CHUNKS], dry[CHUNKS], trials[CHUNKS];
    double built[CHUNKS], wanted[CHUNKS]; /* heights of the part, before the layer and in the end [m] */
} ScanUpdate;

/* Calls `work` on all rows. */
void on_all_rows(RowWork *work, ScanUpdate *scan);

/* Which cells' droplets do not come; leaves the variances of the readings where the first rates were. */
void find_dead(ScanUpdate *scan);

/* How well the prediction explains what the cells of the part grew by; after find_dead. */
void look_at_growth(ScanUpdate *scan);

/* Corrects the heights, their variances and the response. */
void correct_cells(ScanUpdate *scan);

#endif
