/* FMI 3.0: Event Mode, clocks, strings and binaries. */
#include "events.h"
#include "fmi3_component.h"
#include "values.h"

#include <string.h>

/* True, and an error in the log, for a model without Event Mode, and where it is not legal now. */
static bool is_no_event_call(const Component *component, Call call, const char *function) {
    if (!component || FMU_MODEL->update)
        return fmi3_is_illegal(component, call, function);
    misuse(component->core,
           "%s has no Event Mode (hasEventMode in its modelDescription.xml); Step Mode begins with the "
           "end of initialisation",
           FMU_MODEL->table->model);
    fmi3_report(component, function, fmi3Error);
    return true;
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
    const Component *component = instance;
    if (is_no_event_call(component, ENTER_EVENT, __func__))
        return fmi3Error;
    component->core->mode = EVENT;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
    const Component *component = instance;
    if (is_no_event_call(component, ENTER_STEP, __func__))
        return fmi3Error;
    return fmi3_finish(component, ENTER_STEP, __func__, instance_enter_step(component->core));
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime) {
    const Component *component = instance;
    if (is_no_event_call(component, IN_EVENT, __func__))
        return fmi3Error;
    if (!discreteStatesNeedUpdate || !terminateSimulation || !nominalsOfContinuousStatesChanged ||
        !valuesOfContinuousStatesChanged || !nextEventTimeDefined || !nextEventTime)
        return fmi3_finish(component, IN_EVENT, __func__, missing(component->core, "an argument for an answer"));
    const Outcome outcome = instance_update(component->core);
    *discreteStatesNeedUpdate = any_clock_ticks(component->core);
    *terminateSimulation = *nominalsOfContinuousStatesChanged = *valuesOfContinuousStatesChanged = fmi3False;
    *nextEventTimeDefined = fmi3False;
    return fmi3_finish(component, IN_EVENT, __func__, outcome);
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                        fmi3Clock values[]) {
    return ANSWER(instance, GET, get_clocks(core_of(instance), references, count, values));
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                        const fmi3Clock values[]) {
    if (instance && !FMU_MODEL->update && count == 0)
        return fmi3OK;
    if (is_no_event_call(instance, IN_EVENT, __func__))
        return fmi3Error;
    return ANSWER(instance, IN_EVENT, set_clocks(core_of(instance), references, count, values));
}

/* MISUSED for a call whose arrays are missing or of other lengths. */
static Outcome check_call(Instance *instance, const void *references, size_t count, const void *values, size_t total) {
    if (count != total)
        return misuse(instance, "the call names %lu variables and has %lu values", (unsigned long)count,
                      (unsigned long)total);
    return check_arrays(instance, references, values, count);
}

static Outcome get_binaries(Instance *instance, const fmi3ValueReference references[], size_t count, size_t sizes[],
                            fmi3Binary values[], size_t total) {
    Outcome outcome = check_call(instance, references, count, values, total);
    if (outcome == ACCEPTED)
        outcome = check_arrays(instance, references, sizes, count);
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++) {
        const ByteString *value;
        outcome = get_bytes(instance, TYPE_BINARY, references[k], &value);
        if (outcome != ACCEPTED)
            break;
        sizes[k] = value->size;
        values[k] = value->bytes;
    }
    return outcome;
}

static Outcome set_binaries(Instance *instance, const fmi3ValueReference references[], size_t count,
                            const size_t sizes[], const fmi3Binary values[], size_t total) {
    Outcome outcome = check_call(instance, references, count, values, total);
    if (outcome == ACCEPTED)
        outcome = check_arrays(instance, references, sizes, count);
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++)
        outcome = check_bytes(instance, TYPE_BINARY, references[k], values[k], sizes[k]);
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++)
        write_bytes(instance, references[k], values[k], sizes[k]);
    return outcome;
}

static Outcome get_strings(Instance *instance, const fmi3ValueReference references[], size_t count, fmi3String values[],
                           size_t total) {
    Outcome outcome = check_call(instance, references, count, values, total);
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++) {
        const ByteString *value;
        outcome = get_bytes(instance, TYPE_STRING, references[k], &value);
        if (outcome == ACCEPTED)
            values[k] = (const char *)value->bytes;
    }
    return outcome;
}

static size_t length_of(const char *text) {
    return text ? strlen(text) : 0;
}

static Outcome set_strings(Instance *instance, const fmi3ValueReference references[], size_t count,
                           const fmi3String values[], size_t total) {
    Outcome outcome = check_call(instance, references, count, values, total);
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++)
        outcome = check_bytes(instance, TYPE_STRING, references[k], values[k], length_of(values[k]));
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++)
        write_bytes(instance, references[k], values[k], length_of(values[k]));
    return outcome;
}

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference references[], size_t count, size_t sizes[],
                         fmi3Binary values[], size_t total) {
    return ANSWER(instance, GET, get_binaries(core_of(instance), references, count, sizes, values, total));
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                         const size_t sizes[], const fmi3Binary values[], size_t total) {
    return ANSWER(instance, SET, set_binaries(core_of(instance), references, count, sizes, values, total));
}

fmi3Status fmi3GetString(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                         fmi3String values[], size_t total) {
    return ANSWER(instance, GET, get_strings(core_of(instance), references, count, values, total));
}

fmi3Status fmi3SetString(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                         const fmi3String values[], size_t total) {
    return ANSWER(instance, SET, set_strings(core_of(instance), references, count, values, total));
}
