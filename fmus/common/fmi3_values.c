/* FMI 3.0: values and saved states. Every variable has one value reference, its number. */
#include "fmi3_component.h"
#include "snapshot.h"
#include "values.h"

#define ACCESS(Name, TYPE)                                                                                             \
    fmi3Status fmi3Get##Name(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3##Name v[], size_t nv) {      \
        return ANSWER(c, GET, get_values(core_of(c), TYPE, r, n, v, nv));                                              \
    }                                                                                                                  \
    fmi3Status fmi3Set##Name(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3##Name v[],             \
                             size_t nv) {                                                                              \
        return ANSWER(c, SET, set_values(core_of(c), TYPE, r, n, v, nv));                                              \
    }

ACCESS(Float64, TYPE_REAL)
ACCESS(Int32, TYPE_INTEGER)
ACCESS(Boolean, TYPE_BOOLEAN)
ACCESS(Int64, TYPE_ENUMERATION)
ACCESS(UInt64, TYPE_COUNT)

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    return ANSWER(instance, GET_STATE, snapshot_take(core_of(instance), FMUState));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState) {
    return ANSWER(instance, SET_STATE, snapshot_restore(core_of(instance), FMUState));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    (void)instance;
    snapshot_free(FMUState);
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size) {
    return ANSWER(instance, SERIALIZE_STATE, snapshot_size(core_of(instance), FMUState, size));
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[],
                                 size_t size) {
    return ANSWER(instance, SERIALIZE_STATE, snapshot_to_bytes(core_of(instance), FMUState, serializedState, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
                                   fmi3FMUState *FMUState) {
    return ANSWER(instance, SERIALIZE_STATE, snapshot_from_bytes(core_of(instance), serializedState, size, FMUState));
}
