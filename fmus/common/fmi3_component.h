/* The component behind fmi3Instance, and its calls, shared by the files of the FMI 3 adapter. */
#ifndef INKLOOP_FMI3_COMPONENT_H
#define INKLOOP_FMI3_COMPONENT_H

#include "fmi3Functions.h"
#include "lifecycle.h"

typedef struct {
    Instance *core;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Component;

typedef enum {
    SET_DEBUG_LOGGING,
    ENTER_CONFIGURATION,
    EXIT_CONFIGURATION,
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
    ENTER_EVENT,
    ENTER_STEP,
    IN_EVENT
} Call;

/* True, and an error in the log, if the call is not legal in the present mode. */
bool fmi3_is_illegal(const Component *component, Call call, const char *function);

/* The status of an outcome; logs the kept message if it was not accepted. */
fmi3Status fmi3_finish(const Component *component, Call call, const char *function, Outcome outcome);

/* The answer to a call: an error if it is not legal in the present mode, else the status of `outcome`, which is
 * evaluated only then. */
#define ANSWER(component, call, outcome)                                                                               \
    (fmi3_is_illegal(component, call, __func__) ? fmi3Error : fmi3_finish(component, call, __func__, outcome))

static inline Instance *core_of(const Component *component) {
    return component->core;
}

/* Logs the kept message as coming from `function` and returns `status`. */
fmi3Status fmi3_report(const Component *component, const char *function, fmi3Status status);

#endif
