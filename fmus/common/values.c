#include "values.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const char *const TYPE_NAMES[] = {"real",  "integer", "Boolean", "enumeration", "unsigned integer",
                                         "clock", "string",  "binary"};

static const VariableDefinition *definition_of(const Instance *instance, Span span) {
    return &instance->model->table->variables[span.variable];
}

Outcome find_span(Instance *instance, uint32_t reference, Span *span) {
    const size_t *first = instance->first_references, exposed = instance->model->table->exposed_count;
    if (reference >= first[exposed])
        return misuse(instance, "there is no variable with value reference %lu; expected 0 to %lu",
                      (unsigned long)reference, (unsigned long)(first[exposed] - 1));
    size_t found = instance->last_found; /* importers mostly ask for references in order: this one or the next */
    if (reference < first[found])
        found = 0;
    while (reference >= first[found + 1])
        found++;
    instance->last_found = found;
    span->variable = found;
    span->first = instance->has_scalar_references ? reference - first[found] : 0;
    span->count = instance->has_scalar_references ? 1 : value_count(instance, found);
    return ACCEPTED;
}

Outcome check_mode(Instance *instance, const VariableDefinition *definition) {
    switch (definition->causality) {
    case INPUT:
        if (definition->clock > 0 && !*(const bool *)values_of(instance, definition->clock))
            return misuse(instance, "%s cannot be set while its clock does not tick; set %s first", definition->name,
                          instance->model->table->variables[definition->clock].name);
        /* fall through */
    case TUNABLE:
        if (instance->mode & RUNNING)
            return ACCEPTED;
        return misuse(instance, "%s cannot be set in %s", definition->name, mode_name(instance->mode));
    case PARAMETER:
        if (instance->mode & BEFORE_STEP)
            return ACCEPTED;
        return misuse(instance,
                      "%s is a fixed parameter and the instance is in %s; set it before the end of "
                      "initialisation (FMI 3: not in Configuration Mode)",
                      definition->name, mode_name(instance->mode));
    case STRUCTURAL:
        if (instance->is_resizable && instance->mode == CONFIGURATION)
            return ACCEPTED;
        return misuse(instance, "%s %s", definition->name,
                      instance->is_resizable ? "is a structural parameter; set it in Configuration Mode"
                                             : "is a constant here; export an FMU for the grid");
    default:
        return misuse(instance, "%s is calculated by the model; only inputs and parameters can be set",
                      definition->name);
    }
}

double as_double(ValueType type, const void *value) {
    switch (type) {
    case TYPE_REAL:
        return *(const double *)value;
    case TYPE_INTEGER:
        return *(const int32_t *)value;
    case TYPE_BOOLEAN:
        return *(const unsigned char *)value; /* an importer of another language may pass other values than 0 and 1 */
    case TYPE_ENUMERATION:
        return (double)*(const int64_t *)value;
    case TYPE_COUNT:
        return (double)*(const uint64_t *)value;
    case TYPE_CLOCK: /* these have no number */
    case TYPE_STRING:
    case TYPE_BINARY:
        break;
    }
    return NAN;
}

static Outcome refuse_value(Instance *instance, Span span, size_t at, double value) {
    const VariableDefinition *definition = definition_of(instance, span);
    const size_t cell = span.first + at;
    char place[64] = "", expected[96] = "a finite number";
    const size_t row = cell / instance->ny, column = cell % instance->ny;
    if (definition->shape == MAP)
        snprintf(place, sizeof place, " of cell (%lu, %lu)", (unsigned long)row, (unsigned long)column);
    else if (definition->shape == MAPS)
        snprintf(place, sizeof place, " of cell (%lu, %lu) in map %lu", (unsigned long)(row % instance->nx),
                 (unsigned long)column, (unsigned long)(1 + row / instance->nx));
    if (isfinite(definition->min) && isfinite(definition->max))
        snprintf(expected, sizeof expected, "%g to %g", definition->min, definition->max);
    else if (isfinite(definition->min))
        snprintf(expected, sizeof expected, "a finite number not below %g", definition->min);
    return refuse(instance, "%s%s is %g; expected %s; nothing was set", definition->name, place, value, expected);
}

Outcome check_values(Instance *instance, Span span, const void *values) {
    const VariableDefinition *definition = definition_of(instance, span);
    const size_t size = value_size(definition);
    Outcome (*const check_value)(Instance *, size_t, const void *) = instance->model->check_value;
    Outcome outcome = check_mode(instance, definition);
    for (size_t k = 0; k < span.count && outcome == ACCEPTED; k++) {
        const void *value = (const unsigned char *)values + k * size;
        const double number = as_double(definition->type, value);
        if (!isfinite(number) || number < definition->min || number > definition->max)
            return refuse_value(instance, span, k, number);
        outcome = check_value ? check_value(instance, span.variable, value) : ACCEPTED;
    }
    return outcome;
}

static void *place_of(Instance *instance, Span span) {
    return (unsigned char *)values_of(instance, span.variable) + span.first * value_size(definition_of(instance, span));
}

void write_values(Instance *instance, Span span, const void *values) {
    memcpy(place_of(instance, span), values, span.count * value_size(definition_of(instance, span)));
    values_changed(instance);
}

void values_changed(Instance *instance) {
    instance->is_outdated = !(instance->mode & INITIALIZED);
}

void update_outputs(Instance *instance) {
    if (!instance->is_outdated || instance->mode == CONFIGURATION) /* nx and ny may differ from those of the block */
        return;
    instance->model->calculate(instance);
    instance->is_outdated = false;
}

const void *read_values(Instance *instance, Span span) {
    if (definition_of(instance, span)->causality == OUTPUT)
        update_outputs(instance);
    return place_of(instance, span);
}

Outcome check_arrays(Instance *instance, const void *references, const void *values, size_t count) {
    if (count == 0 || (references && values))
        return ACCEPTED;
    return misuse(instance, "the call names %lu variables, but its %s are missing", (unsigned long)count,
                  references ? "values" : "value references");
}

Outcome find_typed(Instance *instance, ValueType type, uint32_t reference, size_t left, Span *span) {
    const Outcome outcome = find_span(instance, reference, span);
    if (outcome != ACCEPTED)
        return outcome;
    const VariableDefinition *definition = definition_of(instance, *span);
    if (definition->type != type)
        return misuse(instance, "%s is of type %s, not %s", definition->name, TYPE_NAMES[definition->type],
                      TYPE_NAMES[type]);
    if (span->count > left)
        return misuse(instance, "%s takes %lu values; the call has only %lu left for it", definition->name,
                      (unsigned long)span->count, (unsigned long)left);
    return ACCEPTED;
}

static Outcome check_total(Instance *instance, size_t used, size_t value_total) {
    if (used == value_total)
        return ACCEPTED;
    return misuse(instance, "the variables take %lu values together; the call has %lu", (unsigned long)used,
                  (unsigned long)value_total);
}

Outcome get_values(Instance *instance, ValueType type, const uint32_t references[], size_t count, void *values,
                   size_t value_total) {
    size_t used = 0;
    if (check_arrays(instance, references, values, count) != ACCEPTED)
        return MISUSED;
    for (size_t k = 0; k < count; k++) {
        Span span;
        const Outcome outcome = find_typed(instance, type, references[k], value_total - used, &span);
        if (outcome != ACCEPTED)
            return outcome;
        const size_t size = value_size(definition_of(instance, span));
        memcpy((unsigned char *)values + used * size, read_values(instance, span), span.count * size);
        used += span.count;
    }
    return check_total(instance, used, value_total);
}

Outcome set_values(Instance *instance, ValueType type, const uint32_t references[], size_t count, const void *values,
                   size_t value_total) {
    const unsigned char *bytes = values;
    size_t used = 0;
    Span span;
    if (check_arrays(instance, references, values, count) != ACCEPTED)
        return MISUSED;
    for (size_t k = 0; k < count; k++) {
        Outcome outcome = find_typed(instance, type, references[k], value_total - used, &span);
        if (outcome == ACCEPTED)
            outcome = check_values(instance, span, bytes + used * value_size(definition_of(instance, span)));
        if (outcome != ACCEPTED)
            return outcome;
        used += span.count;
    }
    if (check_total(instance, used, value_total) != ACCEPTED)
        return MISUSED;
    for (size_t k = 0; k < count; k++) {
        find_span(instance, references[k], &span);
        write_values(instance, span, bytes);
        bytes += span.count * value_size(definition_of(instance, span));
    }
    return ACCEPTED;
}
