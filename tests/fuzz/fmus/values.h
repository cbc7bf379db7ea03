/* Numbers and references for a call, mostly valid and sometimes arbitrary. */
#ifndef INKLOOP_FUZZ_VALUES_H
#define INKLOOP_FUZZ_VALUES_H

#include "input.h"
#include "subject.h"

/* Calls that get or set, with any references and any numbers. */
void any_access(Subject *subject, Input *input, bool sets);

/* Sets parameters that only mean work, and are as a new instance has them, to little; where they may be set. */
void spare_work(Subject *subject);

/* A time or a length: small, huge, below 0, or no number. */
double any_number(Input *input);

#endif
