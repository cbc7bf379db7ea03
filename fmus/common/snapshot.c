#include "snapshot.h"

#include "values.h"

#include <stdlib.h>
#include <string.h>

enum { FINGERPRINT_SIZE = 16 };
enum { LARGE_STATE = 1 << 20 }; /* bytes above which values are not kept from step to step (assumed) */

typedef struct {
    char fingerprint[FINGERPRINT_SIZE];
    uint64_t nx, ny, depth, mode, kept_size;
    uint64_t checksum; /* checksum of everything else: addresses in memory are computed from sizes in a state */
} Header;

/* Any change of a single word changes the sum; a change of several words goes undetected with probability 2^-64. */
static uint64_t add_to_checksum(uint64_t sum, const void *bytes, size_t size) {
    static const uint64_t ODD = UINT64_C(0x9E3779B97F4A7C15); /* 2^64 over the golden ratio */
    for (size_t at = 0; at < size; at += sizeof sum) {
        uint64_t word = 0;
        memcpy(&word, (const unsigned char *)bytes + at, size - at < sizeof word ? size - at : sizeof word);
        sum = (sum ^ word) * ODD;
        sum ^= sum >> 32;
    }
    return sum;
}

/* Of a whole state, header and values. */
static uint64_t checksum_of(const unsigned char *bytes, size_t size) {
    Header header;
    memcpy(&header, bytes, sizeof header);
    header.checksum = 0;
    return add_to_checksum(add_to_checksum(size, &header, sizeof header), bytes + sizeof header, size - sizeof header);
}

static Header header_of(const Instance *instance) {
    Header header = {.nx = instance->nx,
                     .ny = instance->ny,
                     .depth = instance->depth,
                     .mode = instance->mode,
                     .kept_size = instance->kept_size};
    memcpy(header.fingerprint, instance->model->table->fingerprint, FINGERPRINT_SIZE);
    return header;
}

static Outcome check_snapshot(Instance *instance, const void *bytes, size_t size) {
    const Header own = header_of(instance);
    Header found;
    if (!bytes || size < sizeof found)
        return misuse(instance, "the state has %lu bytes; not even its head fits", (unsigned long)size);
    memcpy(&found, bytes, sizeof found);
    if (memcmp(found.fingerprint, own.fingerprint, FINGERPRINT_SIZE) != 0)
        return misuse(instance, "the state is not of this build of %s; restore it into the FMU that saved it",
                      instance->model->table->model);
    if (found.nx != own.nx || found.ny != own.ny)
        return misuse(instance, "the state is of a grid of %llu x %llu cells; this instance has %llu x %llu",
                      (unsigned long long)found.nx, (unsigned long long)found.ny, (unsigned long long)own.nx,
                      (unsigned long long)own.ny);
    if (found.depth != own.depth)
        return misuse(instance, "the state has %s %llu; this instance has %llu",
                      instance->model->table->variables[DEPTH].name, (unsigned long long)found.depth,
                      (unsigned long long)own.depth);
    const bool is_mode = found.mode == INSTANTIATED || found.mode == INITIALIZATION || found.mode == STEP ||
                         found.mode == TERMINATED || (found.mode == EVENT && instance->model->update);
    const uint64_t expected = sizeof found + instance->saved_size + found.kept_size;
    if (size != expected || found.kept_size > size || !is_mode)
        return misuse(instance, "the state is damaged: %lu bytes; expected %llu", (unsigned long)size,
                      (unsigned long long)expected);
    return ACCEPTED;
}

static Outcome check_checksum(Instance *instance, const void *bytes, size_t size) {
    Header header;
    memcpy(&header, bytes, sizeof header);
    if (header.checksum == checksum_of(bytes, size))
        return ACCEPTED;
    return misuse(instance,
                  "the state is damaged: its checksum is %016llx, its bytes give %016llx; restore one that is "
                  "as it was saved",
                  (unsigned long long)header.checksum, (unsigned long long)checksum_of(bytes, size));
}

static Snapshot *sized(Snapshot *old, size_t size) {
    if (old && old->size == size)
        return old;
    Snapshot *snapshot = realloc(old, sizeof *snapshot + size);
    if (snapshot)
        snapshot->size = size;
    return snapshot;
}

/* Copy for going back within a step: without its checksum. */
static Outcome copy_state(Instance *instance, Snapshot **snapshot) {
    update_outputs(instance); /* so that two states are equal if all readable values are */
    const Header header = header_of(instance);
    Snapshot *taken = sized(*snapshot, sizeof header + instance->saved_size + instance->kept_size);
    if (!taken)
        return misuse(instance, "no memory for a state of %lu bytes",
                      (unsigned long)(instance->saved_size + instance->kept_size));
    memcpy(taken->bytes, &header, sizeof header);
    storage_save(instance, taken->bytes + sizeof header);
    if (instance->kept_size > 0)
        memcpy(taken->bytes + sizeof header + instance->saved_size, instance->kept, instance->kept_size);
    *snapshot = taken;
    return ACCEPTED;
}

Outcome snapshot_take(Instance *instance, void **state) {
    Header header;
    Snapshot *snapshot = state ? *state : NULL;
    if (!state)
        return missing(instance, "the place for a state");
    if (copy_state(instance, &snapshot) != ACCEPTED)
        return MISUSED;
    memcpy(&header, snapshot->bytes, sizeof header);
    header.checksum = checksum_of(snapshot->bytes, snapshot->size);
    memcpy(snapshot->bytes, &header, sizeof header);
    *state = snapshot;
    return ACCEPTED;
}

void snapshot_free(void **state) {
    if (state) {
        free(*state);
        *state = NULL;
    }
}

Outcome snapshot_size(Instance *instance, const void *state, size_t *size) {
    const Snapshot *snapshot = state;
    if (!snapshot || !size)
        return missing(instance, "the state or the place for its size");
    *size = snapshot->size;
    return ACCEPTED;
}

Outcome snapshot_to_bytes(Instance *instance, const void *state, void *bytes, size_t size) {
    const Snapshot *snapshot = state;
    if (!snapshot || !bytes)
        return missing(instance, "the state or the buffer for it");
    if (size < snapshot->size)
        return misuse(instance, "the buffer has %lu bytes; the state takes %lu", (unsigned long)size,
                      (unsigned long)snapshot->size);
    memcpy(bytes, snapshot->bytes, snapshot->size);
    return ACCEPTED;
}

Outcome snapshot_restore(Instance *instance, const void *state) {
    const Snapshot *snapshot = state;
    if (!snapshot)
        return misuse(instance, "there is no state to restore");
    const Outcome outcome = check_snapshot(instance, snapshot->bytes, snapshot->size);
    if (outcome != ACCEPTED)
        return outcome;
    Header header;
    memcpy(&header, snapshot->bytes, sizeof header);
    void *kept = kept_memory(instance, header.kept_size);
    if (!kept && header.kept_size > 0)
        return misuse(instance, "no memory for the %llu bytes that the state keeps in addition to the variables",
                      (unsigned long long)header.kept_size);
    if (kept)
        memcpy(kept, snapshot->bytes + sizeof header + instance->saved_size, header.kept_size);
    storage_load(instance, snapshot->bytes + sizeof header);
    instance->mode = (Mode)header.mode;
    instance->is_outdated = (header.mode & BEFORE_STEP) != 0;
    return ACCEPTED;
}

Outcome snapshot_from_bytes(Instance *instance, const void *bytes, size_t size, void **state) {
    Outcome outcome = state ? check_snapshot(instance, bytes, size) : missing(instance, "the place for a state");
    if (outcome == ACCEPTED)
        outcome = check_checksum(instance, bytes, size);
    if (outcome != ACCEPTED)
        return outcome;
    Snapshot *taken = sized(*state, size);
    if (!taken)
        return misuse(instance, "no memory for a state of %lu bytes", (unsigned long)size);
    memcpy(taken->bytes, bytes, size);
    *state = taken;
    return ACCEPTED;
}

bool keep_values(Instance *instance) {
    instance->is_before_step_kept = copy_state(instance, &instance->before) == ACCEPTED;
    return instance->is_before_step_kept;
}

void drop_values(Instance *instance) {
    if (!instance->before || instance->before->size < LARGE_STATE)
        return;
    free(instance->before);
    instance->before = NULL;
}
