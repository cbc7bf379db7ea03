/* FMI 3.0: values and saved states. Every variable has one value reference, its number. */
#include "fmi3_component.h"
#include "snapshot.h"
#include "values.h"

#include <stdlib.h>
#include <string.h>

#define ACCESS(Name, TYPE)                                                                                             \
    fmi3Status fmi3Get##Name(fmi3Instance instance, const fmi3ValueReference valueReferences[],                        \
                             size_t nValueReferences, fmi3##Name values[], size_t nValues) {                           \
        const Component *component = instance;                                                                         \
        if (fmi3_is_illegal(component, GET, __func__))                                                                 \
            return fmi3Error;                                                                                          \
        return fmi3_finish(component, GET, __func__,                                                                   \
                           get_values(component->core, TYPE, valueReferences, nValueReferences, values, nValues));     \
    }                                                                                                                  \
    fmi3Status fmi3Set##Name(fmi3Instance instance, const fmi3ValueReference valueReferences[],                        \
                             size_t nValueReferences, const fmi3##Name values[], size_t nValues) {                     \
        const Component *component = instance;                                                                         \
        if (fmi3_is_illegal(component, SET, __func__))                                                                 \
            return fmi3Error;                                                                                          \
        return fmi3_finish(component, SET, __func__,                                                                   \
                           set_values(component->core, TYPE, valueReferences, nValueReferences, values, nValues));     \
    }

ACCESS(Float64, TYPE_REAL)
ACCESS(Int32, TYPE_INTEGER)
ACCESS(Boolean, TYPE_BOOLEAN)
ACCESS(Int64, TYPE_ENUMERATION)
ACCESS(UInt64, TYPE_COUNT)

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    const Component *component = instance;
    if (fmi3_is_illegal(component, GET_STATE, __func__))
        return fmi3Error;
    if (!FMUState)
        return fmi3_finish(component, GET_STATE, __func__, missing(component->core, "FMUState"));
    Snapshot *snapshot = *FMUState;
    const Outcome outcome = snapshot_take(component->core, &snapshot);
    *FMUState = snapshot;
    return fmi3_finish(component, GET_STATE, __func__, outcome);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState) {
    const Component *component = instance;
    if (fmi3_is_illegal(component, SET_STATE, __func__))
        return fmi3Error;
    return fmi3_finish(component, SET_STATE, __func__, snapshot_restore(component->core, FMUState));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    (void)instance;
    if (FMUState) {
        free(*FMUState);
        *FMUState = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size) {
    const Component *component = instance;
    if (fmi3_is_illegal(component, SERIALIZE_STATE, __func__))
        return fmi3Error;
    if (!FMUState || !size)
        return fmi3_finish(component, SERIALIZE_STATE, __func__, missing(component->core, "FMUState or size"));
    *size = ((const Snapshot *)FMUState)->size;
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[],
                                 size_t size) {
    const Component *component = instance;
    const Snapshot *snapshot = FMUState;
    if (fmi3_is_illegal(component, SERIALIZE_STATE, __func__))
        return fmi3Error;
    if (!snapshot || !serializedState)
        return fmi3_finish(component, SERIALIZE_STATE, __func__,
                           missing(component->core, "FMUState or serializedState"));
    if (size < snapshot->size)
        return fmi3_finish(component, SERIALIZE_STATE, __func__,
                           misuse(component->core, "the buffer has %lu bytes; the state takes %lu", (unsigned long)size,
                                  (unsigned long)snapshot->size));
    memcpy(serializedState, snapshot->bytes, snapshot->size);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
                                   fmi3FMUState *FMUState) {
    const Component *component = instance;
    if (fmi3_is_illegal(component, SERIALIZE_STATE, __func__))
        return fmi3Error;
    if (!FMUState)
        return fmi3_finish(component, SERIALIZE_STATE, __func__, missing(component->core, "FMUState"));
    Snapshot *snapshot = *FMUState;
    const Outcome outcome = snapshot_from_bytes(component->core, serializedState, size, &snapshot);
    *FMUState = snapshot;
    return fmi3_finish(component, SERIALIZE_STATE, __func__, outcome);
}
