#include "fmi2FunctionTypes.h"
#include "fmu.h"

#include <dlfcn.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Every function of co-simulation that the target calls, by its name in the standard. */
#define FUNCTIONS(DO)                                                                                                  \
    DO(Instantiate)                                                                                                    \
    DO(FreeInstance)                                                                                                   \
    DO(SetDebugLogging)                                                                                                \
    DO(SetupExperiment)                                                                                                \
    DO(EnterInitializationMode)                                                                                        \
    DO(ExitInitializationMode)                                                                                         \
    DO(DoStep)                                                                                                         \
    DO(CancelStep)                                                                                                     \
    DO(Terminate)                                                                                                      \
    DO(Reset)                                                                                                          \
    DO(GetReal)                                                                                                        \
    DO(GetInteger)                                                                                                     \
    DO(GetBoolean)                                                                                                     \
    DO(SetReal)                                                                                                        \
    DO(SetInteger)                                                                                                     \
    DO(SetBoolean)                                                                                                     \
    DO(SetString)                                                                                                      \
    DO(GetDirectionalDerivative)                                                                                       \
    DO(GetRealOutputDerivatives)                                                                                       \
    DO(SetRealInputDerivatives)                                                                                        \
    DO(GetStatus)                                                                                                      \
    DO(GetStringStatus)                                                                                                \
    DO(GetRealStatus)                                                                                                  \
    DO(GetFMUstate)                                                                                                    \
    DO(SetFMUstate)                                                                                                    \
    DO(FreeFMUstate)                                                                                                   \
    DO(SerializedFMUstateSize)                                                                                         \
    DO(SerializeFMUstate)                                                                                              \
    DO(DeSerializeFMUstate)

#define POINTER(Name) fmi2##Name##TYPE *Name;
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
#define FIND(Name) all = found(library, "fmi2" #Name, &call.Name) && all;
    FUNCTIONS(FIND)
    return all;
}

static void on_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                       fmi2String format, ...) {
    Log *log = environment;
    va_list arguments;
    log->count += strcmp(name, "it") == 0 && ((status == fmi2Discard && strcmp(category, "logStatusDiscard") == 0) ||
                                              (status == fmi2Error && strcmp(category, "logStatusError") == 0));
    va_start(arguments, format);
    vsnprintf(log->text, sizeof log->text, format, arguments);
    va_end(arguments);
}

/* The standard lets an instance keep the pointer to the callbacks, so each has its own. */
typedef struct {
    fmi2Component component;
    fmi2CallbackFunctions callbacks;
} Kept;

static void *instantiate(const char *token, const char *resources, Log *log) {
    Kept *kept = malloc(sizeof *kept);
    if (!kept)
        return NULL;
    kept->callbacks = (fmi2CallbackFunctions){on_message, NULL, NULL, NULL, log};
    kept->component = call.Instantiate("it", fmi2CoSimulation, token, resources, &kept->callbacks, false, false);
    if (kept->component)
        return kept;
    free(kept);
    return NULL;
}

static void release(void *it) {
    Kept *kept = it;
    call.FreeInstance(kept->component);
    free(kept);
}

static fmi2Component component(void *it) {
    return ((Kept *)it)->component;
}

static char kind(char type) {
    return type == 'e' || type == 'c' ? 'i' : type;
}

static size_t value_size(char of) {
    return of == 'r' ? sizeof(fmi2Real) : sizeof(fmi2Integer);
}

static double encode(char of, double number, void *value) {
    const double whole = isnan(number) ? 0.0 : trunc(number);
    if (of == 'r') {
        memcpy(value, &number, sizeof number);
        return number;
    }
    const fmi2Integer integer = whole >= 2147483647.0 ? INT_MAX : whole < -2147483648.0 ? INT_MIN : (int)whole;
    memcpy(value, &integer, sizeof integer);
    return of == 'b' ? integer != 0 : integer; /* anything but 0 is true */
}

static double decode(char of, const void *value) {
    double real;
    fmi2Integer integer;
    if (of == 'r') {
        memcpy(&real, value, sizeof real);
        return real;
    }
    memcpy(&integer, value, sizeof integer);
    return integer;
}

static Status get(void *it, char of, const uint32_t references[], size_t count, void *values, size_t total) {
    (void)total;
    switch (of) {
    case 'r':
        return call.GetReal(component(it), references, count, values);
    case 'b':
        return call.GetBoolean(component(it), references, count, values);
    default:
        return call.GetInteger(component(it), references, count, values);
    }
}

static Status set(void *it, char of, const uint32_t references[], size_t count, const void *values, size_t total) {
    (void)total;
    switch (of) {
    case 'r':
        return call.SetReal(component(it), references, count, values);
    case 'b':
        return call.SetBoolean(component(it), references, count, values);
    default:
        return call.SetInteger(component(it), references, count, values);
    }
}

static Status enter(void *it, double start) {
    const fmi2Status status = call.SetupExperiment(component(it), false, 0.0, start, false, 0.0);
    if (status != fmi2OK)
        return status;
    return call.EnterInitializationMode(component(it));
}

static Status step(void *it, double start, double size) {
    return call.DoStep(component(it), start, size, true);
}

static Status serialize(void *it, void *state, unsigned char *bytes, size_t size) {
    return call.SerializeFMUstate(component(it), state, (fmi2Byte *)bytes, size);
}

static Status deserialize(void *it, const unsigned char *bytes, size_t size, void **state) {
    return call.DeSerializeFMUstate(component(it), (const fmi2Byte *)bytes, size, state);
}

static Status set_categories(void *it, size_t count, const char *const categories[]) {
    fmi2String given[4] = {NULL};
    memcpy(given, categories, (count < 4 ? count : 4) * sizeof *given);
    return call.SetDebugLogging(component(it), true, count, given);
}

static Status senseless(void *it, unsigned which) {
    fmi2Component c = component(it);
    const fmi2ValueReference reference = 1;
    const fmi2Integer order = 1;
    const fmi2String text = "text";
    fmi2String answer;
    double value = 1.0;
    fmi2Byte byte = 0;
    fmi2FMUstate state = NULL;
    fmi2Status status;
    size_t size;
    switch (which % 19) {
    case 0:
        return call.CancelStep(c);
    case 1:
        return call.SetString(c, &reference, 1, &text);
    case 2:
        return call.GetDirectionalDerivative(c, &reference, 1, &reference, 1, &value, &value);
    case 3:
        return call.GetRealOutputDerivatives(c, &reference, 1, &order, &value);
    case 4:
        return call.SetRealInputDerivatives(c, &reference, 1, &order, &value);
    case 5:
        return call.GetStatus(c, fmi2DoStepStatus, &status);
    case 6:
        return call.GetStringStatus(c, fmi2PendingStatus, &answer);
    case 7:
        return call.SetDebugLogging(c, true, 1, &text);
    case 8:
        return call.SetDebugLogging(c, true, 1, NULL);
    case 9:
        return call.GetReal(c, NULL, 1, &value);
    case 10:
        return call.GetReal(c, &reference, 1, NULL);
    case 11:
        return call.SetReal(c, &reference, 1, NULL);
    case 12:
        return call.GetFMUstate(c, NULL);
    case 13:
        return call.SetFMUstate(c, NULL);
    case 14:
        return call.SerializedFMUstateSize(c, NULL, &size);
    case 15:
        return call.SerializeFMUstate(c, NULL, &byte, 1);
    case 16:
        return call.DeSerializeFMUstate(c, NULL, 1000, &state);
    case 17:
        return call.GetRealStatus(c, fmi2LastSuccessfulTime, NULL);
    default:
        return call.DeSerializeFMUstate(c, &byte, 1, NULL);
    }
}

static Status exit_initialization(void *it) {
    return call.ExitInitializationMode(component(it));
}

static Status terminate(void *it) {
    return call.Terminate(component(it));
}

static Status reset(void *it) {
    return call.Reset(component(it));
}

static Status get_state(void *it, void **state) {
    return call.GetFMUstate(component(it), state);
}

static Status set_state(void *it, void *state) {
    return call.SetFMUstate(component(it), state);
}

static Status free_state(void *it, void **state) {
    return call.FreeFMUstate(component(it), state);
}

static Status state_size(void *it, void *state, size_t *size) {
    return call.SerializedFMUstateSize(component(it), state, size);
}

const Version VERSION_2 = {.load = load,
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
                           .get_state = get_state,
                           .set_state = set_state,
                           .free_state = free_state,
                           .state_size = state_size,
                           .serialize = serialize,
                           .deserialize = deserialize,
                           .set_categories = set_categories,
                           .senseless = senseless};
