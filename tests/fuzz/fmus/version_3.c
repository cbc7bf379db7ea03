#include "fmi3FunctionTypes.h"
#include "fmu.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Every function of co-simulation that the target calls, by its name in the standard. */
#define FUNCTIONS(DO)                                                                                                  \
    DO(InstantiateCoSimulation)                                                                                        \
    DO(FreeInstance)                                                                                                   \
    DO(SetDebugLogging)                                                                                                \
    DO(EnterConfigurationMode)                                                                                         \
    DO(ExitConfigurationMode)                                                                                          \
    DO(EnterInitializationMode)                                                                                        \
    DO(ExitInitializationMode)                                                                                         \
    DO(DoStep)                                                                                                         \
    DO(Terminate)                                                                                                      \
    DO(Reset)                                                                                                          \
    DO(GetFloat64)                                                                                                     \
    DO(GetInt32)                                                                                                       \
    DO(GetBoolean)                                                                                                     \
    DO(GetInt64)                                                                                                       \
    DO(GetUInt64)                                                                                                      \
    DO(SetFloat64)                                                                                                     \
    DO(SetInt32)                                                                                                       \
    DO(SetBoolean)                                                                                                     \
    DO(SetInt64)                                                                                                       \
    DO(SetUInt64)                                                                                                      \
    DO(GetFMUState)                                                                                                    \
    DO(SetFMUState)                                                                                                    \
    DO(FreeFMUState)                                                                                                   \
    DO(SerializedFMUStateSize)                                                                                         \
    DO(SerializeFMUState)                                                                                              \
    DO(DeserializeFMUState)                                                                                            \
    DO(EnterEventMode)                                                                                                 \
    DO(EnterStepMode)                                                                                                  \
    DO(UpdateDiscreteStates)                                                                                           \
    DO(GetClock)                                                                                                       \
    DO(SetClock)                                                                                                       \
    DO(GetBinary)                                                                                                      \
    DO(SetBinary)                                                                                                      \
    DO(SetString)

#define NAME(Name) "fmi3" #Name
#define TYPE(Name) fmi3##Name##TYPE
#define STATE(before, after) before##FMUState##after
#define INSTANCE(it) (it)
#define EVENTS &EVENT_CALLS
#include "version_calls.h"

static void on_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text) {
    Log *log = environment;
    log->count += (status == fmi3Discard && strcmp(category, "logStatusDiscard") == 0) ||
                  (status == fmi3Error && strcmp(category, "logStatusError") == 0);
    snprintf(log->text, sizeof log->text, "%s", text);
}

static void *instantiate(const char *token, const char *resources, bool with_events, Log *log) {
    return call.InstantiateCoSimulation("it", token, resources, false, false, with_events, false, NULL, 0, log,
                                        on_message, NULL);
}

static char kind(char type) {
    return type;
}

static size_t value_size(char of) {
    return of == 'b' ? sizeof(fmi3Boolean) : of == 'i' ? sizeof(fmi3Int32) : sizeof(fmi3Float64);
}

static double encode(char of, double number, void *value) {
    const double whole = isnan(number) ? 0.0 : trunc(number);
    if (of == 'r') {
        memcpy(value, &number, sizeof number);
        return number;
    }
    if (of == 'b') { /* a byte that is no Boolean too, as an importer of another language may send it */
        const unsigned char byte = whole < 0.0 || whole > 255.0 ? 255 : (unsigned char)whole;
        memcpy(value, &byte, sizeof byte);
        return byte;
    }
    if (of == 'i') {
        const fmi3Int32 integer = whole >= 2147483647.0 ? INT32_MAX : whole < -2147483648.0 ? INT32_MIN : (int)whole;
        memcpy(value, &integer, sizeof integer);
        return integer;
    }
    if (of == 'e') {
        const fmi3Int64 item = whole >= 0x1p63 ? INT64_MAX : whole < -0x1p63 ? INT64_MIN : (fmi3Int64)whole;
        memcpy(value, &item, sizeof item);
        return (double)item;
    }
    const fmi3UInt64 count = whole < 0.0 || whole >= 0x1p64 ? UINT64_MAX : (fmi3UInt64)whole;
    memcpy(value, &count, sizeof count);
    return (double)count;
}

static double decode(char of, const void *value) {
    union {
        double real;
        fmi3Int32 integer;
        unsigned char byte;
        fmi3Int64 item;
        fmi3UInt64 count;
    } is;
    memcpy(&is, value, value_size(of));
    return of == 'r'   ? is.real
           : of == 'b' ? is.byte
           : of == 'i' ? is.integer
           : of == 'e' ? (double)is.item
                       : (double)is.count;
}

static Status get(void *it, char of, const uint32_t references[], size_t count, void *values, size_t total) {
    switch (of) {
    case 'r':
        return call.GetFloat64(it, references, count, values, total);
    case 'i':
        return call.GetInt32(it, references, count, values, total);
    case 'b':
        return call.GetBoolean(it, references, count, values, total);
    case 'e':
        return call.GetInt64(it, references, count, values, total);
    default:
        return call.GetUInt64(it, references, count, values, total);
    }
}

static Status set(void *it, char of, const uint32_t references[], size_t count, const void *values, size_t total) {
    switch (of) {
    case 'r':
        return call.SetFloat64(it, references, count, values, total);
    case 'i':
        return call.SetInt32(it, references, count, values, total);
    case 'b':
        return call.SetBoolean(it, references, count, values, total);
    case 'e':
        return call.SetInt64(it, references, count, values, total);
    default:
        return call.SetUInt64(it, references, count, values, total);
    }
}

static Status enter(void *it, double start) {
    return call.EnterInitializationMode(it, false, 0.0, start, false, 0.0);
}

static Status step(void *it, double start, double size, bool *event) {
    bool stop, early;
    double reached;
    return call.DoStep(it, start, size, true, event, &stop, &early, &reached);
}

static Status enter_event(void *it) {
    return call.EnterEventMode(it);
}

static Status enter_step(void *it) {
    return call.EnterStepMode(it);
}

static Status update(void *it, bool *again) {
    bool stop, nominals, values, defined;
    double next;
    return call.UpdateDiscreteStates(it, again, &stop, &nominals, &values, &defined, &next);
}

static Status get_clock(void *it, uint32_t reference, bool *ticks) {
    return call.GetClock(it, &reference, 1, ticks);
}

static Status set_clock(void *it, uint32_t reference, bool ticks) {
    return call.SetClock(it, &reference, 1, &ticks);
}

static Status get_binary(void *it, uint32_t reference, size_t *size, const uint8_t **bytes) {
    return call.GetBinary(it, &reference, 1, size, bytes, 1);
}

static Status set_binary(void *it, uint32_t reference, size_t size, const uint8_t *bytes) {
    return call.SetBinary(it, &reference, 1, &size, &bytes, 1);
}

static Status set_string(void *it, uint32_t reference, const char *text) {
    return call.SetString(it, &reference, 1, &text, 1);
}

static const EventCalls EVENT_CALLS = {enter_event, enter_step, update,     get_clock,
                                       set_clock,   get_binary, set_binary, set_string};

static Status configure(void *it, bool enters) {
    if (enters)
        return call.EnterConfigurationMode(it);
    return call.ExitConfigurationMode(it);
}

static Status deserialize(void *it, const unsigned char *bytes, size_t size, void **state) {
    return call.DeserializeFMUState(it, bytes, size, state);
}

static void release(void *it) {
    call.FreeInstance(it);
}

const Version VERSION_3 = VERSION_OF_CALLS(configure);
