/* Counter-based random numbers: a number depends on its place alone, never on the order of evaluation.
 *
 * Philox 4x32-10 (Salmon, Moraes, Dror, Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3"), key (seed, stream),
 * counter (cell low, cell high, number of the layer or scan, 0). */
#ifndef INKLOOP_RANDOM_H
#define INKLOOP_RANDOM_H

#include <stdint.h>

typedef enum {
    STREAM_DROPLET = 1,
    STREAM_CELL,
    STREAM_LAYER,
    STREAM_NOZZLE,
    STREAM_WHITE_NOISE,
    STREAM_COMMON_NOISE,
    STREAM_DROPOUT,
    STREAM_SHIFT
} Stream;

void philox(const uint32_t key[2], const uint32_t counter[4], uint32_t word[4]);

/* Uniform on [0, 1), 53 bits. */
double random_uniform(int32_t seed, Stream stream, uint64_t cell, int32_t number);

/* Standard normal (Box-Muller, cosine branch). */
double random_normal(int32_t seed, Stream stream, uint64_t cell, int32_t number);

#endif
