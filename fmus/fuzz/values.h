/* Numbers and references for a call, mostly right and sometimes anything. */
#ifndef INKLOOP_FUZZ_VALUES_H
#define INKLOOP_FUZZ_VALUES_H

#include "input.h"
#include "subject.h"

/* Calls that get or set, with any references and any numbers. */
void any_access(Subject *subject, Input *input, bool sets);

/* A time or a length: small, huge, below 0, or no number. */
double any_number(Input *input);

#endif
