/* Event Mode of an instance: clocks, and bytes of any kind at its binaries and strings. */
#ifndef INKLOOP_FUZZ_EVENTS_H
#define INKLOOP_FUZZ_EVENTS_H

#include "input.h"
#include "subject.h"

/* Handles what waits, with these operations for the bus if `sends`, and goes back to Step Mode. */
bool events_handle(Subject *subject, Input *input, bool sends);

/* One call, whatever the mode. */
void any_event_call(Subject *subject, Input *input);

#endif
