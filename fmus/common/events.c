#include "events.h"

#include "values.h"

#include <string.h>

bool any_clock_ticks(Instance *instance) {
    const VariableTable *table = instance->model->table;
    for (size_t k = 0; instance->model->update && k < table->exposed_count; k++)
        if (table->variables[k].type == TYPE_CLOCK && *(const bool *)values_of(instance, k))
            return true;
    return false;
}

static Outcome find_clock(Instance *instance, uint32_t reference, size_t *variable) {
    Span span;
    const Outcome outcome = find_typed(instance, TYPE_CLOCK, reference, 1, &span);
    *variable = span.variable;
    return outcome;
}

Outcome get_clocks(Instance *instance, const uint32_t references[], size_t count, bool ticks[]) {
    size_t clock;
    Outcome outcome = check_arrays(instance, references, ticks, count);
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++) {
        outcome = find_clock(instance, references[k], &clock);
        if (outcome == ACCEPTED)
            ticks[k] = *(const bool *)values_of(instance, clock);
    }
    return outcome;
}

static Outcome check_clock(Instance *instance, uint32_t reference, bool ticks) {
    size_t clock;
    const Outcome outcome = find_clock(instance, reference, &clock);
    if (outcome != ACCEPTED)
        return outcome;
    const VariableDefinition *definition = &instance->model->table->variables[clock];
    if (definition->causality != INPUT)
        return misuse(instance, "%s is a clock of the model; only input clocks can be set", definition->name);
    if (!ticks && *(const bool *)values_of(instance, clock))
        return misuse(instance, "%s ticks and cannot be set back (canBeDeactivated is false)", definition->name);
    return ACCEPTED;
}

Outcome set_clocks(Instance *instance, const uint32_t references[], size_t count, const bool ticks[]) {
    size_t clock;
    Outcome outcome = check_arrays(instance, references, ticks, count);
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++)
        outcome = check_clock(instance, references[k], ticks[k]);
    for (size_t k = 0; k < count && outcome == ACCEPTED; k++) {
        find_clock(instance, references[k], &clock);
        *(bool *)values_of(instance, clock) = ticks[k];
    }
    return outcome;
}

Outcome instance_update(Instance *instance) {
    const VariableTable *table = instance->model->table;
    const Outcome outcome = instance->model->update(instance);
    for (size_t k = 0; k < table->exposed_count && outcome == ACCEPTED; k++)
        if (table->variables[k].type == TYPE_CLOCK && table->variables[k].causality == INPUT)
            *(bool *)values_of(instance, k) = false;
    return outcome;
}

Outcome instance_enter_step(Instance *instance) {
    if (any_clock_ticks(instance))
        return misuse(instance, "a clock still ticks; end the instant first (fmi3UpdateDiscreteStates)");
    instance->mode = STEP;
    return ACCEPTED;
}

Outcome get_bytes(Instance *instance, ValueType type, uint32_t reference, const ByteString **value) {
    Span span;
    const Outcome outcome = find_typed(instance, type, reference, 1, &span);
    if (outcome == ACCEPTED)
        *value = read_values(instance, span);
    return outcome;
}

Outcome check_bytes(Instance *instance, ValueType type, uint32_t reference, const void *bytes, size_t size) {
    Span span;
    Outcome outcome = find_typed(instance, type, reference, 1, &span);
    if (outcome != ACCEPTED)
        return outcome;
    const VariableDefinition *definition = &instance->model->table->variables[span.variable];
    VariableDefinition as_if = *definition;
    as_if.clock = size == 0 ? 0 : definition->clock;
    outcome = check_mode(instance, &as_if);
    if (outcome != ACCEPTED)
        return outcome;
    if (!bytes && (size > 0 || type == TYPE_STRING))
        return missing(instance, definition->name);
    if ((double)size > definition->max)
        return refuse(instance, "%s has %lu bytes; expected at most %g; nothing was set", definition->name,
                      (unsigned long)size, definition->max);
    const bool is_checked = type == TYPE_STRING && instance->model->check_value;
    return is_checked ? instance->model->check_value(instance, span.variable, bytes) : ACCEPTED;
}

void write_bytes(Instance *instance, uint32_t reference, const void *bytes, size_t size) {
    Span span;
    find_span(instance, reference, &span);
    ByteString *value = values_of(instance, span.variable);
    memset(value, 0, sizeof *value + value->size); /* equal values are equal memory */
    value->size = (uint32_t)size;
    if (size > 0)
        memcpy(value->bytes, bytes, size);
    values_changed(instance);
}
