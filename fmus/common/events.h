/* Event Mode (FMI 3): clocks tick in it, and only while its clock ticks a clocked input is set. Strings and binaries.
 */
#ifndef INKLOOP_EVENTS_H
#define INKLOOP_EVENTS_H

#include "storage.h"

/* Whether a clock ticks that Event Mode has not handled yet. */
bool any_clock_ticks(Instance *instance);

/* Clocks by value reference. Only input clocks are set, in Event Mode, and none is set back. */
Outcome get_clocks(Instance *instance, const uint32_t references[], size_t count, bool ticks[]);
Outcome set_clocks(Instance *instance, const uint32_t references[], size_t count, const bool ticks[]);

/* End of an instant of Event Mode; the input clocks fall silent. */
Outcome instance_update(Instance *instance);

/* Back to Step Mode. MISUSED while a clock ticks. */
Outcome instance_enter_step(Instance *instance);

/* Value of a string or binary, as it is until the next call that changes it. */
Outcome get_bytes(Instance *instance, ValueType type, uint32_t reference, const ByteString **value);

/* Checks a new value of a string or binary, then writes it. An empty value is taken also while the clock does not
 * tick. */
Outcome check_bytes(Instance *instance, ValueType type, uint32_t reference, const void *bytes, size_t size);
void write_bytes(Instance *instance, uint32_t reference, const void *bytes, size_t size);

#endif
