/* The measurement frames of the emulated nodes, at the cycles of inkloop.dbc. Droplets, lamp and scans are those of the
 * world; temperatures, back pressure and irradiance are constants, assumed. */
#ifndef INKLOOP_MEASUREMENTS_H
#define INKLOOP_MEASUREMENTS_H

#include "bench.h"
#include "can_frame.h"

typedef struct {
    bool begun[BENCH_NODES];
    uint32_t sent[BENCH_NODES]; /* [ms] */
} Measurements;

/* The next frame of a node that is due, if any. */
bool measurements_next(Measurements *measurements, Bench *bench, int node, uint32_t now, CanFrame *frame);

#endif
