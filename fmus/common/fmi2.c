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

fmi2Status fmi2_unsupported(const Component *component, const char *function) {
    if (!component)
        return fmi2Error;
    return fmi2_finish(component, UNSUPPORTED, function,
                       misuse(component->core, "%s offers nothing for this call; see its modelDescription.xml",
                              FMU_MODEL->table->model));
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
    const Component *component = c;
    (void)loggingOn; /* there are no debug messages */
    if (fmi2_is_illegal(component, SET_DEBUG_LOGGING, __func__))
        return fmi2Error;
    return fmi2_finish(component, SET_DEBUG_LOGGING, __func__,
                       check_categories(component->core, nCategories, categories));
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
    const Component *component = c;
    if (fmi2_is_illegal(component, ENTER_INITIALIZATION, __func__))
        return fmi2Error;
    return fmi2_finish(component, ENTER_INITIALIZATION, __func__,
                       instance_enter_initialization(component->core, instance_time(component->core)));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    const Component *component = c;
    if (fmi2_is_illegal(component, EXIT_INITIALIZATION, __func__))
        return fmi2Error;
    return fmi2_finish(component, EXIT_INITIALIZATION, __func__, instance_exit_initialization(component->core));
}

fmi2Status fmi2Terminate(fmi2Component c) {
    const Component *component = c;
    if (fmi2_is_illegal(component, TERMINATE, __func__))
        return fmi2Error;
    component->core->mode = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    const Component *component = c;
    if (fmi2_is_illegal(component, RESET, __func__))
        return fmi2Error;
    return fmi2_finish(component, RESET, __func__, instance_reset(component->core));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    const Component *component = c;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (fmi2_is_illegal(component, DO_STEP, __func__))
        return fmi2Error;
    return fmi2_finish(component, DO_STEP, __func__,
                       instance_do_step(component->core, currentCommunicationPoint, communicationStepSize));
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    const Component *component = c;
    if (!component || s != fmi2LastSuccessfulTime)
        return fmi2_unsupported(component, __func__);
    if (!value)
        return fmi2_finish(component, UNSUPPORTED, __func__, missing(component->core, "value"));
    *value = instance_time(component->core);
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    if (!c || s != fmi2Terminated)
        return fmi2_unsupported(c, __func__);
    if (!value)
        return fmi2_finish(c, UNSUPPORTED, __func__, missing(((const Component *)c)->core, "value"));
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
    (void)s, (void)value;
    return fmi2_unsupported(c, __func__);
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    (void)s, (void)value;
    return fmi2_unsupported(c, __func__);
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    (void)s, (void)value;
    return fmi2_unsupported(c, __func__);
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    return fmi2_unsupported(c, __func__);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[]) {
    (void)vUnknown_ref, (void)nUnknown, (void)vKnown_ref, (void)nKnown, (void)dvKnown, (void)dvUnknown;
    return fmi2_unsupported(c, __func__);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return nvr == 0 ? fmi2OK : fmi2_unsupported(c, __func__);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return nvr == 0 ? fmi2OK : fmi2_unsupported(c, __func__);
}
