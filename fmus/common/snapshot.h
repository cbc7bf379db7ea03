/* The whole state of an instance, bit by bit. */
#ifndef INKLOOP_SNAPSHOT_H
#define INKLOOP_SNAPSHOT_H

#include "storage.h"

typedef struct Snapshot {
    size_t size;
    unsigned char bytes[];
} Snapshot;

/* `*snapshot` may hold an older snapshot of the same size, which is reused, or be NULL. */
Outcome snapshot_take(Instance *instance, Snapshot **snapshot);
Outcome snapshot_restore(Instance *instance, const Snapshot *snapshot);
Outcome snapshot_from_bytes(Instance *instance, const void *bytes, size_t size, Snapshot **snapshot);

/* Releases the values kept by `keep_values`, if they are large. */
void drop_values(Instance *instance);

#endif
