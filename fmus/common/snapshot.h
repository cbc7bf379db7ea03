/* The whole state of an instance, bit by bit. */
#ifndef INKLOOP_SNAPSHOT_H
#define INKLOOP_SNAPSHOT_H

#include "storage.h"

typedef struct Snapshot {
    size_t size;
    unsigned char bytes[];
} Snapshot;

/* A snapshot as an importer holds it. `*state` may be an older one, which is reused, or NULL. MISUSED if an argument is
 * NULL, if a state does not fit the instance, or if there is no memory. */
Outcome snapshot_take(Instance *instance, void **state);
Outcome snapshot_restore(Instance *instance, const void *state);
void snapshot_free(void **state);

/* The bytes of a snapshot, and a snapshot of such bytes. */
Outcome snapshot_size(Instance *instance, const void *state, size_t *size);
Outcome snapshot_to_bytes(Instance *instance, const void *state, void *bytes, size_t size);
Outcome snapshot_from_bytes(Instance *instance, const void *bytes, size_t size, void **state);

/* Releases the values kept by `keep_values`, if they are large. */
void drop_values(Instance *instance);

#endif
