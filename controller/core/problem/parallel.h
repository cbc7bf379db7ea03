/* Run the parts of a calculation in threads. Two implementations, one of them linked: parallel_pthread.c (one thread
 * per part) and parallel_none.c (one part after the other, for libraries that need the C library only: the FMUs). */
#ifndef INKLOOP_PARALLEL_H
#define INKLOOP_PARALLEL_H

#include <stddef.h>

enum { MAX_PARALLEL = 64 };
enum { SHARE_CELLS = 8192 }; /* fewer are not worth a thread (assumed) */

/* Number of threads, up to `threads`, that pay for maps of so many cells. */
static inline size_t useful_threads(size_t threads, size_t cells) {
    const size_t most = 1 + cells / SHARE_CELLS < MAX_PARALLEL ? 1 + cells / SHARE_CELLS : MAX_PARALLEL;
    return threads < most ? threads : most;
}

/* Calls `work` with each of `count` shares of `size` bytes, at most MAX_PARALLEL; returns when all are done. */
void run_parallel(void *(*work)(void *share), void *shares, size_t size, size_t count);

#endif
