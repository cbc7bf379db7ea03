/* Clones of inner loops for instruction sets beyond the one that every processor of a kind has, chosen at run time.
 *
 * A clone gives the bits of the plain loop: both do the same operations in the same order, each rounded by IEEE 754,
 * only on more cells at once; AVX2 is taken without fused multiply-add, which rounds once instead of twice.
 * There is no clone for Windows, where gcc keeps the stack on multiples of 16 bytes and AVX2 needs 32 (GCC bug 54412).
 * -DINKLOOP_BASELINE leaves all clones out. */
#ifndef INKLOOP_INSTRUCTION_SETS_H
#define INKLOOP_INSTRUCTION_SETS_H

#include <stddef.h>

#if defined(__GNUC__)
#define INLINED inline __attribute__((always_inline)) /* so that a clone has its own copy */
#else
#define INLINED inline
#endif

/* Before a loop over a few cells: gcc vectorises it, where it would otherwise unroll it. */
#if defined(__GNUC__) && !defined(__clang__)
#define AS_LOOP _Pragma("GCC unroll 1")
#else
#define AS_LOOP
#endif

#if defined(__GNUC__) && defined(__x86_64__) && !defined(_WIN32) && !defined(INKLOOP_BASELINE)
#define WITH_AVX2 __attribute__((target("avx2")))
#define HAS_AVX2 __builtin_cpu_supports("avx2")
#else
#define WITH_AVX2
#define HAS_AVX2 0
#endif

enum { CACHE_LINE = 64 }; /* bytes (mostly) */

/* Prefetches memory: in narrow bands or tiles no processor predicts the next row. The memory may be unallocated. */
static INLINED void prefetch(const void *memory, size_t bytes) {
#if defined(__GNUC__)
    for (size_t k = 0; k < bytes; k += CACHE_LINE)
        __builtin_prefetch((const char *)memory + k, 0);
#else
    (void)memory, (void)bytes;
#endif
}

/* The same for memory that is written next. */
static INLINED void prefetch_to_write(const void *memory, size_t bytes) {
#if defined(__GNUC__)
    for (size_t k = 0; k < bytes; k += CACHE_LINE)
        __builtin_prefetch((const char *)memory + k, 1);
#else
    (void)memory, (void)bytes;
#endif
}

#endif
