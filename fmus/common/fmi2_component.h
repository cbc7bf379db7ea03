/* The component behind fmi2Component, and its calls, shared by the two files of the FMI 2 adapter. */
#ifndef INKLOOP_FMI2_COMPONENT_H
#define INKLOOP_FMI2_COMPONENT_H

#include "fmi2Functions.h"
#include "lifecycle.h"

typedef struct {
    Instance *core;
    char *name;
    fmi2CallbackLogger log;
    fmi2ComponentEnvironment environment;
} Component;

typedef enum {
    SET_DEBUG_LOGGING,
    SETUP_EXPERIMENT,
    ENTER_INITIALIZATION,
    EXIT_INITIALIZATION,
    TERMINATE,
    RESET,
    GET,
    SET,
    GET_STATE,
    SET_STATE,
    SERIALIZE_STATE,
    DO_STEP,
    UNSUPPORTED
} Call;

/* True, and an error in the log, if the call is not legal in the present mode. */
bool fmi2_is_illegal(const Component *component, Call call, const char *function);

/* The status of an outcome; logs the kept message if it was not accepted. */
fmi2Status fmi2_finish(const Component *component, Call call, const char *function, Outcome outcome);

/* The answer to a call: an error if it is not legal in the present mode, else the status of `outcome`, which is
 * evaluated only then. */
#define ANSWER(component, call, outcome)                                                                               \
    (fmi2_is_illegal(component, call, __func__) ? fmi2Error : fmi2_finish(component, call, __func__, outcome))

static inline Instance *core_of(const Component *component) {
    return component->core;
}

#endif
