/* Shares of a work done at the same time, if there are threads (side_by_side.c), or one after another
 * (one_after_another.c, for libraries that must need the C library only). */
#ifndef INKLOOP_SIDE_BY_SIDE_H
#define INKLOOP_SIDE_BY_SIDE_H

#include <stddef.h>

enum { SHARES_AT_ONCE = 64 };

/* Calls `work` with each of `count` shares of `size` bytes, at most SHARES_AT_ONCE; returns when all are done. */
void side_by_side(void *(*work)(void *share), void *shares, size_t size, size_t count);

#endif
