/* Random numbers from a key and a counter: no state, the same bits on every machine (SplitMix64 finaliser,
 * Steele, Lea, Flood 2014). */
#ifndef INKLOOP_COUNTER_RANDOM_H
#define INKLOOP_COUNTER_RANDOM_H

#include <stdint.h>

static inline uint64_t mix64(uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

static inline uint64_t random_word(uint64_t key, uint64_t counter) {
    return mix64(mix64(key) + (counter + 1) * 0x9E3779B97F4A7C15u);
}

/* Number `counter` of the sequence `key`, uniform over 0 .. bound - 1 (bound > 0). The remainder favours small numbers
 * by less than bound / 2^64. */
static inline uint64_t random_below(uint64_t key, uint64_t counter, uint64_t bound) {
    return random_word(key, counter) % bound;
}

/* Number `counter` of the sequence `key`, uniform on [0, 1), 53 bits. */
static inline double random_unit(uint64_t key, uint64_t counter) {
    return (double)(random_word(key, counter) >> 11) * 0x1p-53;
}

#endif
