/* Entry points of the search core. All are pure: arrays in, arrays out, no state between calls, any number of threads.
 * A grid is nx * ny cells in C order; heights in metres. Arrays of the caller are complete and checked before the call.
 */
#ifndef INKLOOP_CORE_H
#define INKLOOP_CORE_H

#include <stddef.h>
#include <stdint.h>

#include "layer_map.h"

#if defined(_WIN32)
#define INKLOOP_CORE_API __declspec(dllexport)
#else
#define INKLOOP_CORE_API __attribute__((visibility("default")))
#endif

enum { CORE_INTERFACE = 1 }; /* counts up with every change of a signature or struct below */
enum { CORE_DONE = 0, CORE_BUDGET = 1, CORE_NO_MEMORY = 2 };

/* The problem of one layer: which allowed cells get a droplet, so that the surface after it comes close to the target.
 */
typedef struct {
    size_t nx, ny;
    const double *height;    /* surface before the layer [m] */
    const double *target;    /* [m] */
    const uint8_t *part;     /* cells that count in the objective; at least one */
    const uint8_t *allowed;  /* cells that may get a droplet */
    const int32_t *material; /* 0 or 1: which ink a droplet on the cell is of */
    Ink ink[2];
    double alpha;
} LayerProblem;

typedef struct {
    double objective;   /* of the pattern returned, evaluated from scratch [m] */
    double incremental; /* the same as the running sums had it [m] */
    int64_t sweeps, flips, swaps, evaluations;
} SearchReport;

/* CORE_INTERFACE of the library: the caller can refuse one that was built for other sources. */
INKLOOP_CORE_API int32_t inkloop_core_interface(void);

/* Surface after one layer of `passes` (1, or 4 in the colours `order`, each on the surface that the last one left).
 * `factor` scales each cell's droplet, NULL: all 1. `scratch` and `after` hold nx * ny; returns what left the grid [m].
 */
INKLOOP_CORE_API double inkloop_layer(size_t nx, size_t ny, const double *height, const int32_t *pattern,
                                      const Ink ink[2], const double *factor, int32_t passes, const int32_t order[4],
                                      double *scratch, double *after);

/* Objective of a pattern (0 none, else a droplet of the cell's material) in *value. CORE_DONE or CORE_NO_MEMORY. */
INKLOOP_CORE_API int32_t inkloop_objective(const LayerProblem *problem, const int32_t *pattern, double *value);

/* Improves `pattern` (in: start, out: 0 none, 1 + material) by `annealing_sweeps` sweeps of annealing, then by flips
 * and swaps until neither helps (CORE_DONE) or for `sweeps_max` sweeps (CORE_BUDGET). Without annealing it never gets
 * worse and needs no seed. The same input gives the same bits. */
INKLOOP_CORE_API int32_t inkloop_search(const LayerProblem *problem, int32_t *pattern, int64_t annealing_sweeps,
                                        int64_t sweeps_max, uint64_t seed, SearchReport *report);

/* The stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C) with random batches of at most `batch` cells. */
INKLOOP_CORE_API int32_t inkloop_paper_search(const LayerProblem *problem, int32_t *pattern, int64_t batch,
                                              int64_t iterations_max, uint64_t seed, SearchReport *report);

#endif
