#include "fmi2FunctionTypes.h"
#include "fmu.h"

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
    DO(Terminate)                                                                                                      \
    DO(Reset)                                                                                                          \
    DO(GetReal)                                                                                                        \
    DO(GetInteger)                                                                                                     \
    DO(GetBoolean)                                                                                                     \
    DO(SetReal)                                                                                                        \
    DO(SetInteger)                                                                                                     \
    DO(SetBoolean)                                                                                                     \
    DO(GetFMUstate)                                                                                                    \
    DO(SetFMUstate)                                                                                                    \
    DO(FreeFMUstate)                                                                                                   \
    DO(SerializedFMUstateSize)                                                                                         \
    DO(SerializeFMUstate)                                                                                              \
    DO(DeSerializeFMUstate)

/* The standard lets an instance keep the pointer to the callbacks, so each has its own. */
typedef struct {
    fmi2Component component;
    fmi2CallbackFunctions callbacks;
} Kept;

#define NAME(Name) "fmi2" #Name
#define TYPE(Name) fmi2##Name##TYPE
#define STATE(before, after) before##FMUstate##after
#define INSTANCE(it) ((Kept *)(it))->component
#define EVENTS NULL
#include "version_calls.h"

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

static void *instantiate(const char *token, const char *resources, bool with_events, Log *log) {
    (void)with_events;
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
    call.FreeInstance(INSTANCE(it));
    free(it);
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
        return call.GetReal(INSTANCE(it), references, count, values);
    case 'b':
        return call.GetBoolean(INSTANCE(it), references, count, values);
    default:
        return call.GetInteger(INSTANCE(it), references, count, values);
    }
}

static Status set(void *it, char of, const uint32_t references[], size_t count, const void *values, size_t total) {
    (void)total;
    switch (of) {
    case 'r':
        return call.SetReal(INSTANCE(it), references, count, values);
    case 'b':
        return call.SetBoolean(INSTANCE(it), references, count, values);
    default:
        return call.SetInteger(INSTANCE(it), references, count, values);
    }
}

static Status enter(void *it, double start) {
    const fmi2Status status = call.SetupExperiment(INSTANCE(it), false, 0.0, start, false, 0.0);
    if (status != fmi2OK)
        return status;
    return call.EnterInitializationMode(INSTANCE(it));
}

static Status step(void *it, double start, double size, bool *event) {
    *event = false;
    return call.DoStep(INSTANCE(it), start, size, true);
}

static Status deserialize(void *it, const unsigned char *bytes, size_t size, void **state) {
    return call.DeSerializeFMUstate(INSTANCE(it), (const fmi2Byte *)bytes, size, state);
}

const Version VERSION_2 = VERSION_OF_CALLS(NULL);
