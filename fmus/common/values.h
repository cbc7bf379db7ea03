/* Reading and setting values by value reference, with all checks. */
#ifndef INKLOOP_VALUES_H
#define INKLOOP_VALUES_H

#include "storage.h"

/* Object of a value reference: a whole variable or one cell of it. */
typedef struct {
    size_t variable, first, count;
} Span;

Outcome find_span(Instance *instance, uint32_t reference, Span *span);

/* The same for a variable of this type, of at most `left` values. */
Outcome find_typed(Instance *instance, ValueType type, uint32_t reference, size_t left, Span *span);

/* MISUSED if the variable cannot be set now. */
Outcome check_mode(Instance *instance, const VariableDefinition *definition);

/* A value of this type as a number; not a number for a type without one. */
double as_double(ValueType type, const void *value);

/* After a value was set: outputs that may depend on it are calculated before they are read. */
void values_changed(Instance *instance);

/* MISUSED if the variable cannot be set now, REFUSED if a value is not accepted; `values` are of the variable's own
 * type. */
Outcome check_values(Instance *instance, Span span, const void *values);
void write_values(Instance *instance, Span span, const void *values);
const void *read_values(Instance *instance, Span span);

/* Calculates the outputs if a value that they may depend on was set before the first step. */
void update_outputs(Instance *instance);

/* MISUSED if a call that names `count` variables comes without references or values. */
Outcome check_arrays(Instance *instance, const void *references, const void *values, size_t count);

/* Several references of one type at once, all or nothing. */
Outcome get_values(Instance *instance, ValueType type, const uint32_t references[], size_t count, void *values,
                   size_t value_total);
Outcome set_values(Instance *instance, ValueType type, const uint32_t references[], size_t count, const void *values,
                   size_t value_total);

#endif
