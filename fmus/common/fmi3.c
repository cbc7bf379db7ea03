/* FMI 3.0 co-simulation: life cycle and steps. */
#include "events.h"
#include "fmi3_component.h"

#include <stdio.h>
#include <stdlib.h>

enum { HOLDS_STATE = RUNNING | TERMINATED };

/* Modes in which each call is legal, and the status of a refusal (FMI 3.0, state machine of co-simulation). */
static const struct {
    unsigned modes;
    fmi3Status refused;
} CALLS[] = {
    [SET_DEBUG_LOGGING] = {ANY_MODE, fmi3Error},
    [ENTER_CONFIGURATION] = {INSTANTIATED, fmi3Error},
    [EXIT_CONFIGURATION] = {CONFIGURATION, fmi3Error},
    [ENTER_INITIALIZATION] = {INSTANTIATED, fmi3Error},
    [EXIT_INITIALIZATION] = {INITIALIZATION, fmi3Error},
    [TERMINATE] = {INITIALIZED, fmi3Error},
    [RESET] = {ANY_MODE, fmi3Error},
    [GET] = {ANY_MODE, fmi3Error},
    [SET] = {RUNNING | CONFIGURATION, fmi3Discard},
    [GET_STATE] = {HOLDS_STATE, fmi3Error},
    [SET_STATE] = {HOLDS_STATE, fmi3Error},
    [SERIALIZE_STATE] = {ANY_MODE, fmi3Error},
    [DO_STEP] = {STEP, fmi3Discard},
    [ENTER_EVENT] = {STEP, fmi3Error},
    [ENTER_STEP] = {EVENT, fmi3Error},
    [IN_EVENT] = {EVENT, fmi3Error},
};

fmi3Status fmi3_report(const Component *component, const char *function, fmi3Status status) {
    char text[MESSAGE_SIZE + 64];
    snprintf(text, sizeof text, "%s: %s", function, component->core->message);
    if (component->log)
        component->log(component->environment, status, status == fmi3Discard ? "logStatusDiscard" : "logStatusError",
                       text);
    return status;
}

bool fmi3_is_illegal(const Component *component, Call call, const char *function) {
    if (!component)
        return true;
    if (component->core->mode & CALLS[call].modes)
        return false;
    misuse(component->core, "not allowed in %s", mode_name(component->core->mode));
    fmi3_report(component, function, fmi3Error);
    return true;
}

fmi3Status fmi3_finish(const Component *component, Call call, const char *function, Outcome outcome) {
    if (outcome == ACCEPTED)
        return fmi3OK;
    return fmi3_report(component, function, outcome == REFUSED ? CALLS[call].refused : fmi3Error);
}

const char *fmi3GetVersion(void) {
    return fmi3Version;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate) {
    (void)instanceName, (void)visible, (void)loggingOn; /* refusals are always logged */
    (void)earlyReturnAllowed, (void)requiredIntermediateVariables, (void)intermediateUpdate;
    char message[MESSAGE_SIZE] = "";
    Component *component = NULL;
    if (eventModeUsed != (FMU_MODEL->update != NULL))
        snprintf(message, sizeof message, "eventModeUsed is %s, but %s %s (hasEventMode)",
                 eventModeUsed ? "true" : "false", FMU_MODEL->table->model,
                 eventModeUsed ? "has no Event Mode" : "has clocks and needs it");
    else if (nRequiredIntermediateVariables > 0)
        snprintf(message, sizeof message, "%s provides no intermediate variables", FMU_MODEL->table->model);
    else if (!(component = calloc(1, sizeof *component)))
        snprintf(message, sizeof message, "no memory for an instance");
    else if (!(component->core = instance_create(FMU_MODEL, instantiationToken, false, resourcePath, message))) {
        free(component);
        component = NULL;
    }
    if (!component) {
        if (logMessage)
            logMessage(instanceEnvironment, fmi3Error, "logStatusError", message);
        return NULL;
    }
    component->environment = instanceEnvironment;
    component->log = logMessage;
    return component;
}

void fmi3FreeInstance(fmi3Instance instance) {
    Component *component = instance;
    if (!component)
        return;
    instance_free(component->core);
    free(component);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[]) {
    (void)loggingOn; /* there are no debug messages */
    return ANSWER(instance, SET_DEBUG_LOGGING, check_categories(core_of(instance), nCategories, categories));
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) {
    return ANSWER(instance, ENTER_CONFIGURATION, instance_enter_configuration(core_of(instance)));
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) {
    return ANSWER(instance, EXIT_CONFIGURATION, instance_exit_configuration(core_of(instance)));
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
    (void)toleranceDefined, (void)tolerance, (void)stopTimeDefined, (void)stopTime;
    return ANSWER(instance, ENTER_INITIALIZATION, instance_enter_initialization(core_of(instance), startTime));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    return ANSWER(instance, EXIT_INITIALIZATION, instance_exit_initialization(core_of(instance)));
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
    const Component *component = instance;
    if (fmi3_is_illegal(component, TERMINATE, __func__))
        return fmi3Error;
    component->core->mode = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    return ANSWER(instance, RESET, instance_reset(core_of(instance)));
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime) {
    const Component *component = instance;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (fmi3_is_illegal(component, DO_STEP, __func__))
        return fmi3Error;
    if (!eventHandlingNeeded || !terminateSimulation || !earlyReturn || !lastSuccessfulTime)
        return fmi3_finish(component, DO_STEP, __func__,
                           missing(component->core, "eventHandlingNeeded, terminateSimulation, earlyReturn or "
                                                    "lastSuccessfulTime"));
    const Outcome outcome = instance_do_step(component->core, currentCommunicationPoint, communicationStepSize);
    *terminateSimulation = *earlyReturn = fmi3False;
    *eventHandlingNeeded = any_clock_ticks(component->core);
    *lastSuccessfulTime = instance_time(component->core);
    return fmi3_finish(component, DO_STEP, __func__, outcome);
}
