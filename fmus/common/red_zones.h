/* Under the address sanitizer, ground between the variables of an instance that nobody may touch, so that what strays
 * from one map into the next is seen; in every other build nothing. */
#ifndef INKLOOP_GAPS_H
#define INKLOOP_GAPS_H

#include "instance.h"

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define INKLOOP_GAPS
#endif
#elif defined(__SANITIZE_ADDRESS__)
#define INKLOOP_GAPS
#endif

#if defined(INKLOOP_GAPS)
#include <sanitizer/asan_interface.h>

enum { GAP = 64 }; /* bytes, as eight cells of a map */

static inline void set_gaps(const Instance *instance, bool are_closed) {
    const VariableTable *table = instance->model->table;
    for (size_t k = 0; k < table->count; k++) {
        const size_t end = instance->offsets[k] + value_count(instance, k) * value_size(table->variables[k].type);
        if (are_closed)
            ASAN_POISON_MEMORY_REGION(instance->block + end, instance->offsets[k + 1] - end);
        else
            ASAN_UNPOISON_MEMORY_REGION(instance->block + end, instance->offsets[k + 1] - end);
    }
}
#else
enum { GAP = 0 };

static inline void set_gaps(const Instance *instance, bool are_closed) {
    (void)instance, (void)are_closed;
}
#endif

/* Around a copy of the whole block. */
static inline void open_gaps(const Instance *instance) {
    set_gaps(instance, false);
}

static inline void close_gaps(const Instance *instance) {
    set_gaps(instance, true);
}

#endif
