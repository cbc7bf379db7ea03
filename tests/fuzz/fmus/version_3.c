#include "fmi3FunctionTypes.h"
#include "fmu.h"

#include <dlfcn.h>
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
    DO(EnterEventMode)                                                                                                 \
    DO(EnterStepMode)                                                                                                  \
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
    DO(GetFloat32)                                                                                                     \
    DO(SetString)                                                                                                      \
    DO(GetDirectionalDerivative)                                                                                       \
    DO(GetOutputDerivatives)                                                                                           \
    DO(GetFMUState)                                                                                                    \
    DO(SetFMUState)                                                                                                    \
    DO(FreeFMUState)                                                                                                   \
    DO(SerializedFMUStateSize)                                                                                         \
    DO(SerializeFMUState)                                                                                              \
    DO(DeserializeFMUState)

#define POINTER(Name) fmi3##Name##TYPE *Name;
static struct {
    FUNCTIONS(POINTER)
} call;

static bool found(void *library, const char *name, void *pointer) {
    void *function = dlsym(library, name);
    memcpy(pointer, &function, sizeof function);
    return function != NULL;
}

static bool load(void *library) {
    bool all = true;
#define FIND(Name) all = found(library, "fmi3" #Name, &call.Name) && all;
    FUNCTIONS(FIND)
    return all;
}

static void on_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text) {
    Log *log = environment;
    log->count += (status == fmi3Discard && strcmp(category, "logStatusDiscard") == 0) ||
                  (status == fmi3Error && strcmp(category, "logStatusError") == 0);
    snprintf(log->text, sizeof log->text, "%s", text);
}

static void *instantiate(const char *token, const char *resources, Log *log) {
    return call.InstantiateCoSimulation("it", token, resources, false, false, false, false, NULL, 0, log, on_message,
                                        NULL);
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

static Status step(void *it, double start, double size) {
    bool event, stop, early;
    double reached;
    return call.DoStep(it, start, size, true, &event, &stop, &early, &reached);
}

static Status configure(void *it, bool enters) {
    if (enters)
        return call.EnterConfigurationMode(it);
    return call.ExitConfigurationMode(it);
}

static Status serialize(void *it, void *state, unsigned char *bytes, size_t size) {
    return call.SerializeFMUState(it, state, bytes, size);
}

static Status deserialize(void *it, const unsigned char *bytes, size_t size, void **state) {
    return call.DeserializeFMUState(it, bytes, size, state);
}

static Status set_categories(void *it, size_t count, const char *const categories[]) {
    fmi3String given[4] = {NULL};
    memcpy(given, categories, (count < 4 ? count : 4) * sizeof *given);
    return call.SetDebugLogging(it, true, count, given);
}

static Status senseless(void *it, unsigned which) {
    const fmi3ValueReference reference = 0;
    const fmi3Int32 order = 1;
    const fmi3String text = "text";
    double value = 1.0, reached;
    float narrow;
    bool flag;
    fmi3Byte byte = 0;
    fmi3FMUState state = NULL;
    size_t size;
    switch (which % 18) {
    case 0:
        return call.GetFloat32(it, &reference, 1, &narrow, 1);
    case 1:
        return call.SetString(it, &reference, 1, &text, 1);
    case 2:
        return call.GetDirectionalDerivative(it, &reference, 1, &reference, 1, &value, 1, &value, 1);
    case 3:
        return call.GetOutputDerivatives(it, &reference, 1, &order, &value, 1);
    case 4:
        return call.EnterEventMode(it);
    case 5:
        return call.EnterStepMode(it);
    case 6:
        return call.SetDebugLogging(it, true, 1, &text);
    case 7:
        return call.SetDebugLogging(it, true, 1, NULL);
    case 8:
        return call.GetFloat64(it, NULL, 1, &value, 1);
    case 9:
        return call.GetFloat64(it, &reference, 1, NULL, 1);
    case 10:
        return call.SetFloat64(it, &reference, 1, NULL, 1);
    case 11:
        return call.DoStep(it, 0.0, 1.0, true, NULL, &flag, &flag, &reached);
    case 12:
        return call.GetFMUState(it, NULL);
    case 13:
        return call.SetFMUState(it, NULL);
    case 14:
        return call.SerializedFMUStateSize(it, NULL, &size);
    case 15:
        return call.SerializeFMUState(it, NULL, &byte, 1);
    case 16:
        return call.DeserializeFMUState(it, NULL, 1000, &state);
    default:
        return call.DeserializeFMUState(it, &byte, 1, NULL);
    }
}

static void release(void *it) {
    call.FreeInstance(it);
}

static Status exit_initialization(void *it) {
    return call.ExitInitializationMode(it);
}

static Status terminate(void *it) {
    return call.Terminate(it);
}

static Status reset(void *it) {
    return call.Reset(it);
}

static Status get_state(void *it, void **state) {
    return call.GetFMUState(it, state);
}

static Status set_state(void *it, void *state) {
    return call.SetFMUState(it, state);
}

static Status free_state(void *it, void **state) {
    return call.FreeFMUState(it, state);
}

static Status state_size(void *it, void *state, size_t *size) {
    return call.SerializedFMUStateSize(it, state, size);
}

const Version VERSION_3 = {.load = load,
                           .instantiate = instantiate,
                           .release = release,
                           .kind = kind,
                           .value_size = value_size,
                           .encode = encode,
                           .decode = decode,
                           .get = get,
                           .set = set,
                           .enter = enter,
                           .exit = exit_initialization,
                           .step = step,
                           .terminate = terminate,
                           .reset = reset,
                           .configure = configure,
                           .get_state = get_state,
                           .set_state = set_state,
                           .free_state = free_state,
                           .state_size = state_size,
                           .serialize = serialize,
                           .deserialize = deserialize,
                           .set_categories = set_categories,
                           .senseless = senseless};
