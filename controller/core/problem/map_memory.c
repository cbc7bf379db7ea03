#if defined(__linux__)
#define _DEFAULT_SOURCE
#endif

#include "map_memory.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

enum { HEAD = 64 }; /* bytes before the memory that hold its length, so that maps begin on a line of the cache */

#if defined(__linux__)
#include <sys/mman.h>

/* smaller memory is reused by the heap from call to call (by trial) */
enum { LARGE_PAGE = 1 << 21, LEAST_PAGES = 16 };

/* Memory from the system, in large pages if possible; NULL if the request is too small for them, or if there is
 * none. */
static void *take_pages(size_t bytes) {
    if (bytes < (size_t)LEAST_PAGES * LARGE_PAGE)
        return NULL;
    void *pages = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (pages == MAP_FAILED)
        return NULL;
    const uintptr_t first = ((uintptr_t)pages + LARGE_PAGE - 1) / LARGE_PAGE * LARGE_PAGE;
    (void)madvise((void *)first, bytes - (first - (uintptr_t)pages), MADV_HUGEPAGE); /* a hint; failure is harmless */
    return pages;
}

static void give_pages(void *pages, size_t bytes) {
    (void)munmap(pages, bytes);
}
#else
static void *take_pages(size_t bytes) {
    (void)bytes;
    return NULL;
}

static void give_pages(void *pages, size_t bytes) {
    (void)pages;
    (void)bytes;
}
#endif

static void *take(size_t count, size_t size, bool is_clear) {
    if (size > 0 && count > (SIZE_MAX - HEAD) / size)
        return NULL;
    const size_t bytes = count * size + HEAD;
    char *memory = take_pages(bytes);
    const size_t paged = memory ? bytes : 0;
    if (!memory)
        memory = is_clear ? calloc(1, bytes) : malloc(bytes);
    if (!memory)
        return NULL;
    *(size_t *)memory = paged;
    return memory + HEAD;
}

void *take_maps(size_t count, size_t size) {
    return take(count, size, true);
}

void *take_raw_maps(size_t count, size_t size) {
    return take(count, size, false);
}

void give_maps(void *memory) {
    if (!memory)
        return;
    char *begin = (char *)memory - HEAD;
    const size_t paged = *(size_t *)begin;
    if (paged > 0)
        give_pages(begin, paged);
    else
        free(begin);
}
