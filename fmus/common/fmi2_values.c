/* FMI 2.0: values and saved states. Every cell of a map has a value reference of its own, row by row. */
#include "fmi2_component.h"
#include "snapshot.h"
#include "values.h"

#include <stdlib.h>
#include <string.h>

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    const Component *component = c;
    if (fmi2_is_illegal(component, GET, __func__))
        return fmi2Error;
    return fmi2_finish(component, GET, __func__, get_values(component->core, TYPE_REAL, vr, nvr, value, nvr));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    const Component *component = c;
    if (fmi2_is_illegal(component, SET, __func__))
        return fmi2Error;
    return fmi2_finish(component, SET, __func__, set_values(component->core, TYPE_REAL, vr, nvr, value, nvr));
}

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

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    const Component *component = c;
    if (fmi2_is_illegal(component, GET, __func__))
        return fmi2Error;
    return fmi2_finish(component, GET, __func__, get_narrow(component->core, false, vr, nvr, value));
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[]) {
    const Component *component = c;
    if (fmi2_is_illegal(component, SET, __func__))
        return fmi2Error;
    return fmi2_finish(component, SET, __func__, set_narrow(component->core, false, vr, nvr, value));
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    const Component *component = c;
    if (fmi2_is_illegal(component, GET, __func__))
        return fmi2Error;
    return fmi2_finish(component, GET, __func__, get_narrow(component->core, true, vr, nvr, value));
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[]) {
    const Component *component = c;
    if (fmi2_is_illegal(component, SET, __func__))
        return fmi2Error;
    return fmi2_finish(component, SET, __func__, set_narrow(component->core, true, vr, nvr, value));
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
    (void)vr, (void)value;
    return nvr == 0 ? fmi2OK : fmi2_unsupported(c, __func__);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[]) {
    (void)vr, (void)value;
    return nvr == 0 ? fmi2OK : fmi2_unsupported(c, __func__);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    const Component *component = c;
    if (fmi2_is_illegal(component, GET_STATE, __func__))
        return fmi2Error;
    if (!FMUstate)
        return fmi2_finish(component, GET_STATE, __func__, missing(component->core, "FMUstate"));
    Snapshot *snapshot = *FMUstate;
    const Outcome outcome = snapshot_take(component->core, &snapshot);
    *FMUstate = snapshot;
    return fmi2_finish(component, GET_STATE, __func__, outcome);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    const Component *component = c;
    if (fmi2_is_illegal(component, SET_STATE, __func__))
        return fmi2Error;
    return fmi2_finish(component, SET_STATE, __func__, snapshot_restore(component->core, FMUstate));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    (void)c;
    if (FMUstate) {
        free(*FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    const Component *component = c;
    if (fmi2_is_illegal(component, SERIALIZE_STATE, __func__))
        return fmi2Error;
    if (!FMUstate || !size)
        return fmi2_finish(component, SERIALIZE_STATE, __func__, missing(component->core, "FMUstate or size"));
    *size = ((const Snapshot *)FMUstate)->size;
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size) {
    const Component *component = c;
    const Snapshot *snapshot = FMUstate;
    if (fmi2_is_illegal(component, SERIALIZE_STATE, __func__))
        return fmi2Error;
    if (!snapshot || !serializedState)
        return fmi2_finish(component, SERIALIZE_STATE, __func__,
                           missing(component->core, "FMUstate or serializedState"));
    if (size < snapshot->size)
        return fmi2_finish(component, SERIALIZE_STATE, __func__,
                           misuse(component->core, "the buffer has %lu bytes; the state takes %lu", (unsigned long)size,
                                  (unsigned long)snapshot->size));
    memcpy(serializedState, snapshot->bytes, snapshot->size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    const Component *component = c;
    if (fmi2_is_illegal(component, SERIALIZE_STATE, __func__))
        return fmi2Error;
    if (!FMUstate)
        return fmi2_finish(component, SERIALIZE_STATE, __func__, missing(component->core, "FMUstate"));
    Snapshot *snapshot = *FMUstate;
    const Outcome outcome = snapshot_from_bytes(component->core, serializedState, size, &snapshot);
    *FMUstate = snapshot;
    return fmi2_finish(component, SERIALIZE_STATE, __func__, outcome);
}
