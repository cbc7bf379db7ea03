/* Reads the text of a fault. */
#ifndef INKLOOP_FAULT_TEXT_H
#define INKLOOP_FAULT_TEXT_H

#include "fault.h"

/* Reads KIND[:key=value,...] into a fault with the defaults of its kind; false, with the message in `why`. */
bool fault_read(Fault *fault, const char *text, char *why, size_t room);

/* Adds the fault of a text; false, with the message in `why`. */
bool faults_add(Faults *faults, const char *text, char *why, size_t room);

#endif
