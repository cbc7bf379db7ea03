/* FMI 2.0 co-simulation: life cycle, steps, and what is not supported. */
#include "fmi2_component.h"
#include "resources.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HOLDS_STATE = RUNNING | TERMINATED };

/* Modes in which each call is legal, and the status of a refusal (FMI 2.0, state machine of co-simulation). */
static const struct {
    unsigned modes;
    fmi2Status refused;
} CALLS[] = {
    [SET_DEBUG_LOGGING] = {ANY_MODE, fmi2Error},
    [SETUP_EXPERIMENT] = {INSTANTIATED, fmi2Error},
    [ENTER_INITIALIZATION] = {INSTANTIATED, fmi2Error},
    [EXIT_INITIALIZATION] = {INITIALIZATION, fmi2Error},
    [TERMINATE] = {STEP, fmi2Error},
    [RESET] = {ANY_MODE, fmi2Error},
    [GET] = {ANY_MODE, fmi2Error},
    [SET] = {RUNNING, fmi2Discard},
    [GET_STATE] = {HOLDS_STATE, fmi2Error},
    [SET_STATE] = {HOLDS_STATE, fmi2Error},
    [SERIALIZE_STATE] = {ANY_MODE, fmi2Error},
    [DO_STEP] = {STEP, fmi2Error},
    [UNSUPPORTED] = {ANY_MODE, fmi2Error},
};

static fmi2Status report(const Component *component, const char *function, fmi2Status status) {
    char text[MESSAGE_SIZE + 64];
    snprintf(text, sizeof text, "%s: %s", function, component->core->message);
    if (component->log)
        component->log(component->environment, component->name, status,
                       status == fmi2Discard ? "logStatusDiscard" : "logStatusError", "%s", text);
    return status;
}

bool fmi2_is_illegal(const Component *component, Call call, const char *function) {
    if (!component)
        return true;
    if (component->core->mode & CALLS[call].modes)
        return false;
    misuse(component->core, "not allowed in %s", mode_name(component->core->mode));
    report(component, function, fmi2Error);
    return true;
}

fmi2Status fmi2_finish(const Component *component, Call call, const char *function, Outcome outcome) {
    if (outcome == ACCEPTED)
        return fmi2OK;
    return report(component, function, outcome == REFUSED ? CALLS[call].refused : fmi2Error);
}

const char *fmi2GetTypesPlatform(void) {
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void) {
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    (void)visible, (void)loggingOn; /* refusals are always logged */
    char message[MESSAGE_SIZE] = "";
    const char *name = instanceName ? instanceName : "";
    Component *component = calloc(1, sizeof *component);
    if (!component)
        return NULL;
    if (fmuType != fmi2CoSimulation)
        snprintf(message, sizeof message, "%s is for co-simulation only", FMU_MODEL->table->model);
    else if (!(component->name = malloc(strlen(name) + 1)))
        snprintf(message, sizeof message, "no memory for an instance");
    else {
        char *resources = resource_path(fmuResourceLocation);
        component->core = instance_create(FMU_MODEL, fmuGUID, true, resources, message);
        free(resources);
    }
    if (!component->core) {
        if (functions && functions->logger)
            functions->logger(functions->componentEnvironment, name, fmi2Error, "logStatusError", "%s", message);
        free(component->name);
        free(component);
        return NULL;
    }
    strcpy(component->name, name);
    component->log = functions ? functions->logger : NULL;
    component->environment = functions ? functions->componentEnvironment : NULL;
    return component;
}

void fmi2FreeInstance(fmi2Component c) {
    Component *component = c;
    if (!component)
        return;
    instance_free(component->core);
    free(component->name);
    free(component);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[]) {
    (void)loggingOn; /* there are no debug messages */
    return ANSWER(c, SET_DEBUG_LOGGING, check_categories(core_of(c), nCategories, categories));
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    const Component *component = c;
    (void)toleranceDefined, (void)tolerance, (void)stopTimeDefined, (void)stopTime;
    if (fmi2_is_illegal(component, SETUP_EXPERIMENT, __func__))
        return fmi2Error;
    const Outcome outcome = instance_enter_initialization(component->core, startTime);
    if (outcome == ACCEPTED)
        component->core->mode = INSTANTIATED; /* the mode changes in fmi2EnterInitializationMode */
    return fmi2_finish(component, SETUP_EXPERIMENT, __func__, outcome);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return ANSWER(c, ENTER_INITIALIZATION, instance_enter_initialization(core_of(c), instance_time(core_of(c))));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return ANSWER(c, EXIT_INITIALIZATION, instance_exit_initialization(core_of(c)));
}

fmi2Status fmi2Terminate(fmi2Component c) {
    const Component *component = c;
    if (fmi2_is_illegal(component, TERMINATE, __func__))
        return fmi2Error;
    component->core->mode = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    return ANSWER(c, RESET, instance_reset(core_of(c)));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    (void)noSetFMUStatePriorToCurrentPoint;
    return ANSWER(c, DO_STEP, instance_do_step(core_of(c), currentCommunicationPoint, communicationStepSize));
}

/* Calls without an effect, on no variables, are accepted; any other is an error. */
static fmi2Status unsupported(const Component *component, const char *function, size_t count) {
    if (count == 0 || !component)
        return count == 0 ? fmi2OK : fmi2Error;
    return fmi2_finish(component, UNSUPPORTED, function,
                       misuse(component->core, "%s offers nothing for this call; see its modelDescription.xml",
                              FMU_MODEL->table->model));
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    if (!c || s != fmi2LastSuccessfulTime)
        return unsupported(c, __func__, 1);
    if (!value)
        return ANSWER(c, UNSUPPORTED, missing(core_of(c), "value"));
    *value = instance_time(core_of(c));
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    if (!c || s != fmi2Terminated)
        return unsupported(c, __func__, 1);
    if (!value)
        return ANSWER(c, UNSUPPORTED, missing(core_of(c), "value"));
    *value = fmi2False;
    return fmi2OK;
}

#define OFFERS_NOTHING(Name, Parameters, count)                                                                        \
    fmi2Status fmi2##Name Parameters {                                                                                 \
        return unsupported(c, __func__, count);                                                                        \
    }

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter" /* the functions below use their count at most */
#elif defined(_MSC_VER)
#pragma warning(disable : 4100)
#endif

typedef fmi2ValueReference Reference;

OFFERS_NOTHING(GetStatus, (fmi2Component c, const fmi2StatusKind s, fmi2Status *value), 1)
OFFERS_NOTHING(GetIntegerStatus, (fmi2Component c, const fmi2StatusKind s, fmi2Integer *value), 1)
OFFERS_NOTHING(GetStringStatus, (fmi2Component c, const fmi2StatusKind s, fmi2String *value), 1)
OFFERS_NOTHING(CancelStep, (fmi2Component c), 1)
OFFERS_NOTHING(GetDirectionalDerivative,
               (fmi2Component c, const Reference u[], size_t nu, const Reference k[], size_t nk, const fmi2Real dk[],
                fmi2Real du[]),
               1)
OFFERS_NOTHING(SetRealInputDerivatives,
               (fmi2Component c, const Reference r[], size_t n, const fmi2Integer o[], const fmi2Real v[]), n)
OFFERS_NOTHING(GetRealOutputDerivatives,
               (fmi2Component c, const Reference r[], size_t n, const fmi2Integer o[], fmi2Real v[]), n)
OFFERS_NOTHING(GetString, (fmi2Component c, const Reference r[], size_t n, fmi2String v[]), n)
OFFERS_NOTHING(SetString, (fmi2Component c, const Reference r[], size_t n, const fmi2String v[]), n)

#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif
