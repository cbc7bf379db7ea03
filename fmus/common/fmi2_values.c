/* FMI 2.0: values and saved states. Every cell of a map has a value reference of its own, row by row. */
#include "fmi2_component.h"
#include "snapshot.h"
#include "values.h"

/* Reads values in the narrow types of FMI 2: one integer type for integers, enumerations and counts; fmi2Boolean is an
 * int. */
static Outcome get_narrow(Instance *instance, bool is_boolean, const fmi2ValueReference vr[], size_t nvr, int value[]) {
    if (check_arrays(instance, vr, value, nvr) != ACCEPTED)
        return MISUSED;
    for (size_t k = 0; k < nvr; k++) {
        Span span;
        if (find_span(instance, vr[k], &span) != ACCEPTED)
            return MISUSED;
        const VariableDefinition *definition = &instance->model->table->variables[span.variable];
        if (definition->type == TYPE_REAL || is_boolean != (definition->type == TYPE_BOOLEAN))
            return misuse(instance, "%s is not of this type; see modelDescription.xml", definition->name);
        const void *found = read_values(instance, span);
        if (is_boolean)
            value[k] = *(const bool *)found ? fmi2True : fmi2False;
        else if (definition->type == TYPE_INTEGER)
            value[k] = *(const int32_t *)found;
        else if (definition->type == TYPE_ENUMERATION)
            value[k] = (int)*(const int64_t *)found;
        else
            value[k] = (int)*(const uint64_t *)found;
    }
    return ACCEPTED;
}

typedef union {
    int32_t integer;
    int64_t enumeration;
    bool boolean;
} Wide;

static Wide widen(ValueType type, int value) {
    if (type == TYPE_ENUMERATION)
        return (Wide){.enumeration = value};
    return type == TYPE_BOOLEAN ? (Wide){.boolean = value != fmi2False} : (Wide){.integer = value};
}

static Outcome set_narrow(Instance *instance, bool is_boolean, const fmi2ValueReference vr[], size_t nvr,
                          const int value[]) {
    Span span;
    if (check_arrays(instance, vr, value, nvr) != ACCEPTED)
        return MISUSED;
    for (size_t k = 0; k < nvr; k++) {
        if (find_span(instance, vr[k], &span) != ACCEPTED)
            return MISUSED;
        const VariableDefinition *definition = &instance->model->table->variables[span.variable];
        if (definition->type == TYPE_REAL || is_boolean != (definition->type == TYPE_BOOLEAN))
            return misuse(instance, "%s is not of this type; see modelDescription.xml", definition->name);
        const Wide wide = widen(definition->type, value[k]);
        const Outcome outcome = check_values(instance, span, &wide);
        if (outcome != ACCEPTED)
            return outcome;
    }
    for (size_t k = 0; k < nvr; k++) {
        find_span(instance, vr[k], &span);
        const Wide wide = widen(instance->model->table->variables[span.variable].type, value[k]);
        write_values(instance, span, &wide);
    }
    return ACCEPTED;
}

#define ACCESS(Name, get, set)                                                                                         \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2##Name value[]) {         \
        return ANSWER(c, GET, get);                                                                                    \
    }                                                                                                                  \
    fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2##Name value[]) {   \
        return ANSWER(c, SET, set);                                                                                    \
    }

ACCESS(Real, get_values(core_of(c), TYPE_REAL, vr, nvr, value, nvr),
       set_values(core_of(c), TYPE_REAL, vr, nvr, value, nvr))
ACCESS(Integer, get_narrow(core_of(c), false, vr, nvr, value), set_narrow(core_of(c), false, vr, nvr, value))
ACCESS(Boolean, get_narrow(core_of(c), true, vr, nvr, value), set_narrow(core_of(c), true, vr, nvr, value))

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    return ANSWER(c, GET_STATE, snapshot_take(core_of(c), FMUstate));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    return ANSWER(c, SET_STATE, snapshot_restore(core_of(c), FMUstate));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    (void)c;
    snapshot_free(FMUstate);
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    return ANSWER(c, SERIALIZE_STATE, snapshot_size(core_of(c), FMUstate, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size) {
    return ANSWER(c, SERIALIZE_STATE, snapshot_to_bytes(core_of(c), FMUstate, serializedState, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    return ANSWER(c, SERIALIZE_STATE, snapshot_from_bytes(core_of(c), serializedState, size, FMUstate));
}
