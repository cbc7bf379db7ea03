/* A foreign FMU for tests: y = gain * x (mode 2: squared), count = steps so far, high = y > 1; refuses x < 0.
 *
 * Compiled with -DFMI=2 (three cells) or -DFMI=3 (n cells, structural; half, a structural switch that halves the gain).
 * A step of 500 s ends the simulation, one with x[1] = 100 is discarded with the instance's name and the text that is
 * its parameter `label`, and after an error it may only be freed. FMI 3
 * divides one of 200 to 400 s into two, by returning early. With -DCRASHES=signal a step after the third raises it. It
 * shares nothing with the FMUs of this project and writes out the signatures of the standard that it needs, so that it
 * stands for the work of others. */
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CELLS_MAX = 64, TEXT_MAX = 32, OK = 0, WARNING = 1, DISCARD = 2, ERROR = 3, FATAL = 4 };
enum { N = 1, HALF = 2, ON = 3, GAIN = 4, MODE = 5, COUNT = 6, X = 100, Y = 200, HIGH = 300 };

typedef void (*Logger2)(void *, const char *, int, const char *, const char *, ...);
typedef void (*Logger3)(void *, int, const char *, const char *);

typedef struct {
    uint64_t n;
    int64_t mode;
    int32_t count;
    bool on, half;
    double gain, x[CELLS_MAX], y[CELLS_MAX];
} State;

typedef struct {
    State state;
    bool is_configured, has_ended, has_failed;
    char name[TEXT_MAX], label[TEXT_MAX];
    void *environment;
    Logger2 log2;
    Logger3 log3;
} Instance;

static int refuse(Instance *instance, int status, const char *message) {
    if (instance->log2)
        instance->log2(instance->environment, "amplifier", status, "logStatus", "%s (%d cells)", message,
                       (int)instance->state.n);
    if (instance->log3)
        instance->log3(instance->environment, status, "logStatus", message);
    return status;
}

static Instance *instantiate(const char *name, void *environment, Logger2 log2, Logger3 log3) {
    Instance *instance = calloc(1, sizeof *instance);
    snprintf(instance->name, TEXT_MAX, "%s", name);
    instance->state = (State){.n = 3, .mode = 1, .on = true, .gain = 2.0};
    instance->environment = environment;
    instance->log2 = log2;
    instance->log3 = log3;
    return instance;
}

static int set_x(Instance *instance, size_t cell, double x) {
    if (x < 0.0)
        return refuse(instance, DISCARD, "x is negative");
    instance->state.x[cell] = x;
    return OK;
}

static int step(Instance *instance, double size) {
    State *state = &instance->state;
    instance->has_ended = size > 450.0 && size < 550.0;
    if (instance->has_ended)
        return OK;
    if (size > 1000.0) {
        instance->has_failed = true;
        return refuse(instance, size > 1e6 ? FATAL : ERROR, "step is too long");
    }
    if (state->x[0] == 100.0) {
        char message[3 * TEXT_MAX];
        snprintf(message, sizeof message, "step is too difficult for %s (%s)", instance->name, instance->label);
        return refuse(instance, DISCARD, message);
    }
#ifdef CRASHES
    if (state->count == 3)
        raise(CRASHES);
#endif
    for (size_t i = 0; i < state->n; i++) {
        const double y = state->on ? (state->half ? 0.5 : 1.0) * state->gain * state->x[i] : 0.0;
        state->y[i] = state->mode == 2 ? y * y : y;
    }
    state->count++;
    return OK;
}

static int end(Instance *instance) {
    return instance->has_failed ? refuse(instance, ERROR, "terminated after an error") : OK;
}

static int copy_state(Instance *instance, void **copy) {
    if (!*copy)
        *copy = malloc(sizeof(State));
    memcpy(*copy, &instance->state, sizeof(State));
    return OK;
}

/* Calls that save and restore the state, alike in both versions but for their names. */
#define STATES(fmi, Noun, Deserialize)                                                                                 \
    int fmi##Get##Noun(Instance *instance, void **state) {                                                             \
        return copy_state(instance, state);                                                                            \
    }                                                                                                                  \
    int fmi##Set##Noun(Instance *instance, const void *state) {                                                        \
        memcpy(&instance->state, state, sizeof(State));                                                                \
        return OK;                                                                                                     \
    }                                                                                                                  \
    int fmi##Free##Noun(Instance *instance, void **state) {                                                            \
        (void)instance;                                                                                                \
        free(*state);                                                                                                  \
        *state = NULL;                                                                                                 \
        return OK;                                                                                                     \
    }                                                                                                                  \
    int fmi##Serialized##Noun##Size(Instance *instance, const void *state, size_t *size) {                             \
        (void)instance, (void)state;                                                                                   \
        *size = sizeof(State);                                                                                         \
        return OK;                                                                                                     \
    }                                                                                                                  \
    int fmi##Serialize##Noun(Instance *instance, const void *state, void *bytes, size_t size) {                        \
        (void)instance;                                                                                                \
        memcpy(bytes, state, size);                                                                                    \
        return OK;                                                                                                     \
    }                                                                                                                  \
    int fmi##Deserialize##Noun(Instance *instance, const void *bytes, size_t size, void **state) {                     \
        copy_state(instance, state);                                                                                   \
        memcpy(*state, bytes, size);                                                                                   \
        return OK;                                                                                                     \
    }

#define DONE_NOTHING(name)                                                                                             \
    int name(void) {                                                                                                   \
        return OK;                                                                                                     \
    }
#define NOT_OFFERED(name)                                                                                              \
    int name(void) {                                                                                                   \
        return ERROR;                                                                                                  \
    }

#define NEITHER_GET_NOR_SET(Name) NOT_OFFERED(fmi3Get##Name) NOT_OFFERED(fmi3Set##Name)

#if FMI == 2

typedef struct {
    Logger2 logger;
    void *allocate, *release, *finished, *environment;
} Callbacks;

const char *fmi2GetTypesPlatform(void) {
    return "default";
}
const char *fmi2GetVersion(void) {
    return "2.0";
}
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const Callbacks *callbacks,
                      int visible, int logging) {
    (void)type, (void)resources, (void)visible, (void)logging;
    return strcmp(guid, "amplifier") ? NULL : instantiate(name, callbacks->environment, callbacks->logger, NULL);
}
void fmi2FreeInstance(Instance *instance) {
    free(instance);
}
int fmi2SetReal(Instance *instance, const uint32_t *reference, size_t count, const double *value) {
    for (size_t i = 0; i < count; i++) {
        if (reference[i] == GAIN)
            instance->state.gain = value[i];
        else if (set_x(instance, reference[i] - X, value[i]))
            return DISCARD;
    }
    return OK;
}
int fmi2GetReal(Instance *instance, const uint32_t *reference, size_t count, double *value) {
    for (size_t i = 0; i < count; i++)
        value[i] = reference[i] == GAIN ? instance->state.gain : instance->state.y[reference[i] - Y];
    return OK;
}
int fmi2SetInteger(Instance *instance, const uint32_t *reference, size_t count, const int32_t *value) {
    for (size_t i = 0; i < count && reference[i] == MODE; i++)
        instance->state.mode = value[i];
    return OK;
}
int fmi2GetInteger(Instance *instance, const uint32_t *reference, size_t count, int32_t *value) {
    for (size_t i = 0; i < count; i++)
        value[i] = reference[i] == MODE ? (int32_t)instance->state.mode : instance->state.count;
    return OK;
}
int fmi2SetBoolean(Instance *instance, const uint32_t *reference, size_t count, const int32_t *value) {
    for (size_t i = 0; i < count && reference[i] == ON; i++)
        instance->state.on = value[i];
    return OK;
}
int fmi2GetBoolean(Instance *instance, const uint32_t *reference, size_t count, int32_t *value) {
    for (size_t i = 0; i < count; i++)
        value[i] = instance->state.y[reference[i] - HIGH] > 1.0;
    return OK;
}
int fmi2DoStep(Instance *instance, double time, double size, int no_rollback) {
    (void)time, (void)no_rollback;
    const int status = step(instance, size);
    return instance->has_ended ? DISCARD : status;
}
int fmi2Terminate(Instance *instance) {
    return end(instance);
}
int fmi2GetBooleanStatus(Instance *instance, int kind, int32_t *value) {
    *value = instance->has_ended;
    return kind == 3 ? OK : DISCARD;
}
STATES(fmi2, FMUstate, DeSerialize)
DONE_NOTHING(fmi2SetupExperiment)
DONE_NOTHING(fmi2EnterInitializationMode)
DONE_NOTHING(fmi2ExitInitializationMode)
NOT_OFFERED(fmi2SetDebugLogging)
NOT_OFFERED(fmi2Reset)
NOT_OFFERED(fmi2CancelStep)
NOT_OFFERED(fmi2GetStatus)
NOT_OFFERED(fmi2GetRealStatus)
NOT_OFFERED(fmi2GetIntegerStatus)
NOT_OFFERED(fmi2GetStringStatus)
NOT_OFFERED(fmi2GetString)
int fmi2SetString(Instance *instance, const uint32_t *reference, size_t count, const char *const *text) {
    (void)reference, (void)count;
    snprintf(instance->label, TEXT_MAX, "%s", text[0]);
    return OK;
}
NOT_OFFERED(fmi2GetDirectionalDerivative)
NOT_OFFERED(fmi2SetRealInputDerivatives)
NOT_OFFERED(fmi2GetRealOutputDerivatives)

#else

const char *fmi3GetVersion(void) {
    return "3.0";
}
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                  bool logging, bool events, bool early, const uint32_t *required, size_t count,
                                  void *environment, Logger3 logger, void *update) {
    (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required, (void)count;
    (void)update;
    return strcmp(token, "amplifier") ? NULL : instantiate(name, environment, NULL, logger);
}
void fmi3FreeInstance(Instance *instance) {
    free(instance);
}
int fmi3SetUInt64(Instance *instance, const uint32_t *reference, size_t count, const uint64_t *value, size_t values) {
    (void)reference, (void)count, (void)values;
    instance->state.n = *value;
    return OK;
}
int fmi3SetFloat64(Instance *instance, const uint32_t *reference, size_t count, const double *value, size_t values) {
    (void)count;
    if (*reference == GAIN) {
        instance->state.gain = *value;
        return OK;
    }
    if (values != instance->state.n)
        return refuse(instance, ERROR, "wrong number of values");
    for (size_t i = 0; i < values; i++)
        if (set_x(instance, i, value[i]))
            return DISCARD;
    return OK;
}
int fmi3GetFloat64(Instance *instance, const uint32_t *reference, size_t count, double *value, size_t values) {
    (void)reference, (void)count;
    if (values != instance->state.n)
        return refuse(instance, ERROR, "wrong number of values");
    memcpy(value, instance->state.y, values * sizeof *value);
    return OK;
}
int fmi3SetInt64(Instance *instance, const uint32_t *reference, size_t count, const int64_t *value, size_t values) {
    (void)reference, (void)count, (void)values;
    instance->state.mode = *value;
    return OK;
}
int fmi3GetInt32(Instance *instance, const uint32_t *reference, size_t count, int32_t *value, size_t values) {
    (void)reference, (void)count, (void)values;
    *value = instance->state.count;
    return OK;
}
int fmi3SetBoolean(Instance *instance, const uint32_t *reference, size_t count, const bool *value, size_t values) {
    (void)count, (void)values;
    if (*reference == HALF && !instance->is_configured)
        return refuse(instance, ERROR, "half is set in Configuration Mode");
    *(*reference == HALF ? &instance->state.half : &instance->state.on) = *value;
    return OK;
}
int fmi3GetBoolean(Instance *instance, const uint32_t *reference, size_t count, bool *value, size_t values) {
    (void)reference, (void)count;
    for (size_t i = 0; i < values; i++)
        value[i] = instance->state.y[i] > 1.0;
    return OK;
}
int fmi3DoStep(Instance *instance, double time, double size, bool no_rollback, bool *event, bool *terminate,
               bool *early, double *last) {
    (void)no_rollback;
    *event = false;
    *early = size >= 200.0 && size <= 400.0;
    if (*early)
        size /= 2.0;
    *last = time + size;
    const int status = step(instance, size);
    *terminate = instance->has_ended;
    return status;
}
int fmi3Terminate(Instance *instance) {
    return end(instance);
}
STATES(fmi3, FMUState, Deserialize)
int fmi3EnterConfigurationMode(Instance *instance) {
    instance->is_configured = true;
    return OK;
}
int fmi3ExitConfigurationMode(Instance *instance) {
    instance->is_configured = false;
    return OK;
}
DONE_NOTHING(fmi3EnterInitializationMode)
DONE_NOTHING(fmi3ExitInitializationMode)
NOT_OFFERED(fmi3InstantiateModelExchange)
NOT_OFFERED(fmi3InstantiateScheduledExecution)
NOT_OFFERED(fmi3SetDebugLogging)
NOT_OFFERED(fmi3Reset)
NOT_OFFERED(fmi3EnterEventMode)
NOT_OFFERED(fmi3EnterStepMode)
NOT_OFFERED(fmi3EnterContinuousTimeMode)
NOT_OFFERED(fmi3CompletedIntegratorStep)
NOT_OFFERED(fmi3EvaluateDiscreteStates)
NOT_OFFERED(fmi3UpdateDiscreteStates)
NOT_OFFERED(fmi3ActivateModelPartition)
NOT_OFFERED(fmi3GetAdjointDerivative)
NOT_OFFERED(fmi3GetDirectionalDerivative)
NOT_OFFERED(fmi3GetOutputDerivatives)
NOT_OFFERED(fmi3GetContinuousStateDerivatives)
NOT_OFFERED(fmi3GetContinuousStates)
NOT_OFFERED(fmi3SetContinuousStates)
NOT_OFFERED(fmi3GetNominalsOfContinuousStates)
NOT_OFFERED(fmi3GetNumberOfContinuousStates)
NOT_OFFERED(fmi3GetEventIndicators)
NOT_OFFERED(fmi3GetNumberOfEventIndicators)
NOT_OFFERED(fmi3GetNumberOfVariableDependencies)
NOT_OFFERED(fmi3GetVariableDependencies)
NOT_OFFERED(fmi3SetTime)
NEITHER_GET_NOR_SET(Binary)
NEITHER_GET_NOR_SET(Clock)
NOT_OFFERED(fmi3GetString)
int fmi3SetString(Instance *instance, const uint32_t *reference, size_t count, const char *const *text, size_t values) {
    (void)reference, (void)count, (void)values;
    snprintf(instance->label, TEXT_MAX, "%s", text[0]);
    return OK;
}
NEITHER_GET_NOR_SET(Float32)
NEITHER_GET_NOR_SET(Int8)
NEITHER_GET_NOR_SET(UInt8)
NEITHER_GET_NOR_SET(Int16)
NEITHER_GET_NOR_SET(UInt16)
NOT_OFFERED(fmi3SetInt32)
NEITHER_GET_NOR_SET(UInt32)
NOT_OFFERED(fmi3GetInt64)
NOT_OFFERED(fmi3GetUInt64)
NEITHER_GET_NOR_SET(IntervalDecimal)
NEITHER_GET_NOR_SET(IntervalFraction)
NEITHER_GET_NOR_SET(ShiftDecimal)
NEITHER_GET_NOR_SET(ShiftFraction)

#endif
