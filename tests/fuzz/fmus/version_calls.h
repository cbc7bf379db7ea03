/* Calls that both versions of the standard have, by names that differ in their prefix. Each of version_2.c and
 * version_3.c includes this once, after its own FUNCTIONS, NAME, TYPE, STATE and INSTANCE. */
#ifndef INKLOOP_FUZZ_VERSION_CALLS_H
#define INKLOOP_FUZZ_VERSION_CALLS_H

#include <string.h>

#include "fmu.h"
#include "shared_library.h"

#define POINTER(Name) TYPE(Name) * Name;
static struct {
    FUNCTIONS(POINTER)
} call;

static bool found(void *library, const char *name, void *pointer) {
    const Symbol function = symbol_of(library, name);
    memcpy(pointer, &function, sizeof function);
    return function != NULL;
}

static bool load(void *library) {
    bool all = true;
#define FIND(Name) all = found(library, NAME(Name), &call.Name) && all;
    FUNCTIONS(FIND)
    return all;
}

static Status exit_initialization(void *it) {
    return call.ExitInitializationMode(INSTANCE(it));
}

static Status terminate(void *it) {
    return call.Terminate(INSTANCE(it));
}

static Status reset(void *it) {
    return call.Reset(INSTANCE(it));
}

static Status get_state(void *it, void **state) {
    return call.STATE(Get, )(INSTANCE(it), state);
}

static Status set_state(void *it, void *state) {
    return call.STATE(Set, )(INSTANCE(it), state);
}

static Status free_state(void *it, void **state) {
    return call.STATE(Free, )(INSTANCE(it), state);
}

static Status state_size(void *it, void *state, size_t *size) {
    return call.STATE(Serialized, Size)(INSTANCE(it), state, size);
}

static Status serialize(void *it, void *state, unsigned char *bytes, size_t size) {
    return call.STATE(Serialize, )(INSTANCE(it), state, (void *)bytes, size);
}

static Status set_categories(void *it, size_t count, const char *const categories[]) {
    const char *given[4] = {NULL};
    memcpy(given, categories, (count < 4 ? count : 4) * sizeof *given);
    return call.SetDebugLogging(INSTANCE(it), true, count, given);
}

/* These and the version's own; `configuring`: its `configure`. */
#define VERSION_OF_CALLS(configuring)                                                                                  \
    {load,                                                                                                             \
     instantiate,                                                                                                      \
     release,                                                                                                          \
     kind,                                                                                                             \
     value_size,                                                                                                       \
     encode,                                                                                                           \
     decode,                                                                                                           \
     get,                                                                                                              \
     set,                                                                                                              \
     enter,                                                                                                            \
     exit_initialization,                                                                                              \
     step,                                                                                                             \
     terminate,                                                                                                        \
     reset,                                                                                                            \
     configuring,                                                                                                      \
     get_state,                                                                                                        \
     set_state,                                                                                                        \
     free_state,                                                                                                       \
     state_size,                                                                                                       \
     serialize,                                                                                                        \
     deserialize,                                                                                                      \
     set_categories,                                                                                                   \
     EVENTS}

#endif
