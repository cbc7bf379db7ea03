#include "random.h"

#include <math.h>

enum { ROUNDS = 10 };
static const uint32_t MULTIPLIER_0 = 0xD2511F53u, MULTIPLIER_1 = 0xCD9E8D57u; /* Salmon et al. 2011, Philox 4x32 */
static const uint32_t WEYL_0 = 0x9E3779B9u, WEYL_1 = 0xBB67AE85u;             /* golden ratio, sqrt(3) - 1 */
static const double TWO_PI = 6.283185307179586476925286766559;

void philox(const uint32_t key[2], const uint32_t counter[4], uint32_t word[4]) {
    uint32_t k0 = key[0], k1 = key[1];
    for (int i = 0; i < 4; i++)
        word[i] = counter[i];
    for (int round = 0; round < ROUNDS; round++) {
        const uint64_t left = (uint64_t)MULTIPLIER_0 * word[0], right = (uint64_t)MULTIPLIER_1 * word[2];
        word[0] = (uint32_t)(right >> 32) ^ word[1] ^ k0;
        word[1] = (uint32_t)right;
        word[2] = (uint32_t)(left >> 32) ^ word[3] ^ k1;
        word[3] = (uint32_t)left;
        k0 += WEYL_0;
        k1 += WEYL_1;
    }
}

static void draw(int32_t seed, Stream stream, uint64_t cell, int32_t number, uint32_t word[4]) {
    const uint32_t key[2] = {(uint32_t)seed, (uint32_t)stream};
    const uint32_t counter[4] = {(uint32_t)cell, (uint32_t)(cell >> 32), (uint32_t)number, 0};
    philox(key, counter, word);
}

static double uniform(uint32_t high, uint32_t low) {
    return (double)((((uint64_t)high << 32) | low) >> 11) * 0x1p-53;
}

double random_uniform(int32_t seed, Stream stream, uint64_t cell, int32_t number) {
    uint32_t word[4];
    draw(seed, stream, cell, number, word);
    return uniform(word[0], word[1]);
}

double random_normal(int32_t seed, Stream stream, uint64_t cell, int32_t number) {
    uint32_t word[4];
    draw(seed, stream, cell, number, word);
    return sqrt(-2.0 * log(1.0 - uniform(word[0], word[1]))) * cos(TWO_PI * uniform(word[2], word[3]));
}
