/* What fmi3Instance points to, shared by the two files of the FMI 3 adapter. */
#ifndef INKLOOP_FMI3_COMPONENT_H
#define INKLOOP_FMI3_COMPONENT_H

#include "fmi3Functions.h"
#include "lifecycle.h"

typedef struct {
    Instance *core;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Component;

/* Logs the kept message as coming from `function` and returns `status`. */
fmi3Status fmi3_report(const Component *component, const char *function, fmi3Status status);

#endif
