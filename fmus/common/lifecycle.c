#include "lifecycle.h"

#include "events.h"
#include "resources.h"
#include "snapshot.h"
#include "values.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

double instance_time(Instance *instance) {
    return *(double *)values_of(instance, TIME);
}

static bool is_possible_depth(const VariableTable *table, uint64_t depth) {
    const VariableDefinition *definition = &table->variables[DEPTH];
    return !has_depth(table) || ((double)depth >= definition->min && (double)depth <= definition->max);
}

/* Reads the sizes in a token; false if the token is not one of this binary. */
static bool read_token(const char *token, Instance *instance) {
    const VariableTable *table = instance->model->table;
    char own[128];
    const int length = snprintf(own, sizeof own, "%s-%s-", table->model, table->fingerprint);
    if (!token || strncmp(token, own, (size_t)length) != 0)
        return false;
    unsigned long long nx = 0, ny = 0, depth = 1;
    int used = 0;
    if (sscanf(token + length, "%llux%llu%n", &nx, &ny, &used) != 2)
        return false;
    const char *rest = token + length + used;
    if (has_depth(table)) {
        if (sscanf(rest, "x%llu%n", &depth, &used) != 1)
            return false;
        rest += used;
    }
    if (*rest != '\0' && (*rest != '-' || strlen(rest) > MARK_SIZE))
        return false;
    strcpy(instance->mark, *rest == '\0' ? "" : rest + 1);
    instance->is_resizable = strcmp(instance->mark, "resizable") == 0;
    instance->start_nx = nx;
    instance->start_ny = ny;
    instance->start_depth = depth;
    return (instance->is_resizable || *instance->mark == '\0' || instance->model->open) && is_possible_grid(nx, ny) &&
           is_possible_depth(table, depth);
}

static Outcome reserve(Instance *instance) {
    return instance->model->reserve ? instance->model->reserve(instance) : ACCEPTED;
}

/* The instance with the start values of its table, and of its resources. */
static Outcome begin(Instance *instance) {
    instance->mode = INSTANTIATED;
    const Outcome outcome = instance->model->open ? instance->model->open(instance) : ACCEPTED;
    return outcome == ACCEPTED ? reserve(instance) : outcome;
}

Instance *instance_create(const Model *model, const char *token, bool has_scalar_references, const char *resources,
                          char message[MESSAGE_SIZE]) {
    Instance *instance = calloc(1, sizeof *instance);
    if (!instance) {
        snprintf(message, MESSAGE_SIZE, "no memory for an instance");
        return NULL;
    }
    instance->model = model;
    instance->has_scalar_references = has_scalar_references;
    if (!read_token(token, instance)) {
        snprintf(
            message, MESSAGE_SIZE,
            "the GUID or instantiation token is %s; this binary expects %s-%s-NXxNY%s as in the modelDescription.xml "
            "of the same FMU",
            token ? token : "missing", model->table->model, model->table->fingerprint,
            has_depth(model->table) ? "xN" : "");
    } else if (!storage_allocate(instance, instance->start_nx, instance->start_ny, instance->start_depth)) {
        snprintf(message, MESSAGE_SIZE, "no memory for %llu x %llu cells", (unsigned long long)instance->start_nx,
                 (unsigned long long)instance->start_ny);
    } else {
        instance->resources = text_copy(resources);
        if (begin(instance) == ACCEPTED)
            return instance;
        memcpy(message, instance->message, MESSAGE_SIZE);
        storage_release(instance);
    }
    free(instance->resources);
    free(instance);
    return NULL;
}

void instance_free(Instance *instance) {
    storage_release(instance);
    free(instance->resources);
    free(instance);
}

Outcome instance_reset(Instance *instance) {
    Instance old = *instance;
    if (!storage_allocate(instance, instance->start_nx, instance->start_ny, instance->start_depth))
        return misuse(instance, "no memory for a second block; the instance is as it was");
    if (begin(instance) != ACCEPTED) {
        memcpy(old.message, instance->message, MESSAGE_SIZE);
        storage_release(instance);
        *instance = old;
        return MISUSED;
    }
    storage_release(&old);
    return ACCEPTED;
}

Outcome instance_enter_configuration(Instance *instance) {
    if (!instance->is_resizable)
        return misuse(instance,
                      "%s has no structural parameters here, its grid is %llu x %llu cells; use the FMI 3 "
                      "variant with structural parameters, or export one for the grid",
                      instance->model->table->model, (unsigned long long)instance->nx,
                      (unsigned long long)instance->ny);
    update_outputs(instance);
    instance->mode = CONFIGURATION;
    return ACCEPTED;
}

Outcome instance_exit_configuration(Instance *instance) {
    const VariableTable *table = instance->model->table;
    const uint64_t nx = *(uint64_t *)values_of(instance, NX), ny = *(uint64_t *)values_of(instance, NY);
    const uint64_t depth = has_depth(table) ? *(uint64_t *)values_of(instance, DEPTH) : instance->depth;
    if (nx == instance->nx && ny == instance->ny && depth == instance->depth) {
        if (reserve(instance) != ACCEPTED)
            return REFUSED;
    } else {
        if (!is_possible_grid(nx, ny))
            return refuse(instance, "nx is %llu, ny is %llu; expected 1 to %llu cells together", (unsigned long long)nx,
                          (unsigned long long)ny, (unsigned long long)MAX_CELLS);
        Instance old = *instance;
        if (!storage_allocate(instance, nx, ny, depth))
            return refuse(instance, "no memory for %llu x %llu cells", (unsigned long long)nx, (unsigned long long)ny);
        for (size_t k = NY + 1; k < table->exposed_count; k++) /* scalars keep their values, maps are reset */
            if (table->variables[k].shape == ONE_VALUE && table->variables[k].causality != STRUCTURAL)
                memcpy(values_of(instance, k), values_of(&old, k), value_size(&table->variables[k]));
        if (reserve(instance) != ACCEPTED) {
            memcpy(old.message, instance->message, MESSAGE_SIZE);
            storage_release(instance);
            *instance = old;
            return REFUSED;
        }
        storage_release(&old);
    }
    instance->mode = INSTANTIATED;
    return ACCEPTED;
}

Outcome instance_enter_initialization(Instance *instance, double start_time) {
    if (!isfinite(start_time))
        return misuse(instance, "the start time is %g; expected a finite number", start_time);
    *(double *)values_of(instance, TIME) = start_time;
    instance->mode = INITIALIZATION;
    instance->is_outdated = true;
    return ACCEPTED;
}

Outcome instance_exit_initialization(Instance *instance) {
    const Outcome outcome = instance->model->initialize(instance);
    if (outcome == ACCEPTED) {
        instance->mode = instance->model->update ? EVENT : STEP;
        instance->is_outdated = false;
    }
    return outcome;
}

/* Restores the beginning of the step if one of its outputs is not finite. */
static Outcome check_outputs(Instance *instance) {
    const VariableTable *table = instance->model->table;
    for (size_t k = 0; k < table->exposed_count; k++) {
        if (table->variables[k].causality != OUTPUT || table->variables[k].type != TYPE_REAL)
            continue;
        const double *values = values_of(instance, k);
        for (size_t cell = 0; cell < value_count(instance, k); cell++) {
            const double value = values[cell];
            if (isfinite(value))
                continue;
            const Outcome restored = snapshot_restore(instance, instance->before);
            if (restored != ACCEPTED)
                return restored;
            return refuse(instance,
                          "%s would be %g after this step; expected parameters and inputs with which the model stays "
                          "finite; the step was not taken",
                          table->variables[k].name, value);
        }
    }
    return ACCEPTED;
}

Outcome instance_do_step(Instance *instance, double start, double step) {
    const double now = instance_time(instance);
    if (any_clock_ticks(instance))
        return misuse(instance, "an event waits (eventHandlingNeeded); handle it in Event Mode before the next step");
    if (!isfinite(start) || !isfinite(step) || !isfinite(start + step) || start + step <= start)
        return refuse(instance, "the step is %g s from %g s on; expected finite numbers and an end after the beginning",
                      step, start);
    const double rounding = 1e-6 * step + 1e-12 * fabs(now); /* importers' times carry rounding */
    if (start < now - rounding)
        return refuse(instance,
                      "the step begins at %.17g s, but the instance is at %.17g s already; restore a saved "
                      "state to go back",
                      start, now);
    if (!storage_take_workplace(instance))
        return refuse(instance, "no memory for a step on %llu x %llu cells", (unsigned long long)instance->nx,
                      (unsigned long long)instance->ny);
    instance->is_before_step_kept = false;
    Outcome outcome = instance->model->do_step(instance, start, start + step);
    if (outcome == ACCEPTED && instance->is_before_step_kept)
        outcome = check_outputs(instance);
    if (outcome == ACCEPTED)
        *(double *)values_of(instance, TIME) = start + step;
    storage_give_workplace(instance);
    drop_values(instance);
    return outcome;
}

Outcome check_categories(Instance *instance, size_t count, const char *const categories[]) {
    for (size_t k = 0; k < count; k++) {
        const char *found = categories && categories[k] ? categories[k] : "NULL";
        if (strcmp(found, "logStatusDiscard") != 0 && strcmp(found, "logStatusError") != 0)
            return misuse(instance, "category is %.100s; expected logStatusDiscard or logStatusError", found);
    }
    return ACCEPTED;
}
