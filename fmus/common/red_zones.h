/* AddressSanitizer red zones between the variables of an instance: an access beyond a map is reported instead of
 * reading the next map. Builds without AddressSanitizer have none. */
#ifndef INKLOOP_RED_ZONES_H
#define INKLOOP_RED_ZONES_H

#include <stdbool.h>
#include <stddef.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define INKLOOP_RED_ZONES
#endif
#elif defined(__SANITIZE_ADDRESS__)
#define INKLOOP_RED_ZONES
#endif

#if defined(INKLOOP_RED_ZONES)
#include <sanitizer/asan_interface.h>

enum { RED_ZONE = 64 }; /* bytes after each variable: eight cells of a map */

static inline void set_red_zone(unsigned char *start, size_t size, bool is_poisoned) {
    if (is_poisoned)
        ASAN_POISON_MEMORY_REGION(start, size);
    else
        ASAN_UNPOISON_MEMORY_REGION(start, size);
}
#else
enum { RED_ZONE = 0 };

static inline void set_red_zone(unsigned char *start, size_t size, bool is_poisoned) {
    (void)start, (void)size, (void)is_poisoned;
}
#endif

#endif
