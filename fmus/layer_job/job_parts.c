#include "job_parts.h"

#include "layer_controller_variables.h"
#include "layer_deposition_variables.h"
#include "profile_sensor_variables.h"
#include "snapshot.h"
#include "superposition_deposition_variables.h"
#include "values.h"
#include "volume_area_deposition_variables.h"
#include "young_laplace_deposition_variables.h"

#include <stdio.h>
#include <string.h>

enum { MODELS_OF_ROLE = 4 };
static const Model *const MODELS[PARTS][MODELS_OF_ROLE] = {
    [PRINTER] = {&LAYER_DEPOSITION, &SUPERPOSITION_DEPOSITION, &VOLUME_AREA_DEPOSITION, &YOUNG_LAPLACE_DEPOSITION},
    [PROFILER] = {&PROFILE_SENSOR},
    [CONTROLLER] = {&LAYER_CONTROLLER},
};

/* The header before the states in the kept memory: the size of each, and the index of its model within its role. */
typedef struct {
    uint64_t size[PARTS], model[PARTS];
} Contents;

const char *role_name(PartRole role) {
    static const char *const NAMES[] = {"printer", "profiler", "controller"};
    return NAMES[role];
}

const Model *model_of_role(PartRole role, const char *name) {
    for (int k = 0; k < MODELS_OF_ROLE && MODELS[role][k]; k++)
        if (strcmp(MODELS[role][k]->table->model, name) == 0)
            return MODELS[role][k];
    return NULL;
}

static uint64_t number_in_role(PartRole role, const Model *model) {
    uint64_t number = 0;
    while (MODELS[role][number] != model)
        number++;
    return number;
}

static Outcome refuse_damaged(Instance *job) {
    return refuse(job, "the state of the print is damaged; restore another one");
}

Outcome refuse_for_part(Instance *job, const JobParts *parts, PartRole role) {
    return refuse(job, "%s: %s", role_name(role), parts->part[role]->message);
}

void close_parts(JobParts *parts) {
    for (int role = 0; role < PARTS; role++) {
        if (parts->part[role])
            instance_free(parts->part[role]);
        parts->part[role] = NULL;
    }
}

Outcome create_parts(Instance *job, const Model *const models[PARTS], JobParts *parts) {
    *parts = (JobParts){{NULL}};
    for (int role = 0; role < PARTS; role++) {
        char token[128], message[MESSAGE_SIZE];
        const int length =
            snprintf(token, sizeof token, "%s-%s-%llux%llu", models[role]->table->model,
                     models[role]->table->fingerprint, (unsigned long long)job->nx, (unsigned long long)job->ny);
        if (has_depth(models[role]->table))
            snprintf(token + length, sizeof token - (size_t)length, "x%llu", (unsigned long long)job->depth);
        parts->part[role] = instance_create(models[role], token, false, NULL, message);
        if (!parts->part[role]) {
            close_parts(parts);
            return refuse(job, "%s: %s", role_name((PartRole)role), message);
        }
    }
    return ACCEPTED;
}

static Outcome restore_part(Instance *job, const JobParts *parts, PartRole role, const unsigned char *bytes,
                            size_t size) {
    Instance *part = parts->part[role];
    void *snapshot = NULL;
    Outcome outcome = snapshot_from_bytes(part, bytes, size, &snapshot);
    if (outcome == ACCEPTED)
        outcome = snapshot_restore(part, snapshot);
    snapshot_free(&snapshot);
    return outcome == ACCEPTED ? ACCEPTED : refuse_for_part(job, parts, role);
}

Outcome open_parts(Instance *job, JobParts *parts) {
    Contents contents;
    size_t left = job->kept_size;
    const Model *models[PARTS];
    *parts = (JobParts){{NULL}};
    if (left < sizeof contents)
        return refuse_damaged(job);
    memcpy(&contents, job->kept, sizeof contents);
    left -= sizeof contents;
    for (int role = 0; role < PARTS; role++) {
        if (contents.model[role] >= MODELS_OF_ROLE || contents.size[role] > left)
            return refuse_damaged(job);
        left -= (size_t)contents.size[role];
        models[role] = MODELS[role][contents.model[role]];
        if (!models[role])
            return refuse_damaged(job);
    }
    Outcome outcome = create_parts(job, models, parts);
    const unsigned char *bytes = job->kept + sizeof contents;
    for (int role = 0; role < PARTS && outcome == ACCEPTED; role++) {
        outcome = restore_part(job, parts, (PartRole)role, bytes, (size_t)contents.size[role]);
        bytes += contents.size[role];
    }
    if (outcome != ACCEPTED)
        close_parts(parts);
    return outcome;
}

Outcome keep_parts(Instance *job, const JobParts *parts) {
    void *snapshots[PARTS] = {NULL};
    Contents contents;
    size_t total = sizeof contents;
    Outcome outcome = ACCEPTED;
    memset(&contents, 0, sizeof contents);
    for (int role = 0; role < PARTS && outcome == ACCEPTED; role++) {
        size_t size = 0;
        if (snapshot_take(parts->part[role], &snapshots[role]) != ACCEPTED)
            outcome = refuse_for_part(job, parts, (PartRole)role);
        else
            snapshot_size(job, snapshots[role], &size);
        contents.size[role] = size;
        contents.model[role] = number_in_role((PartRole)role, parts->part[role]->model);
        total += size;
    }
    unsigned char *bytes = outcome == ACCEPTED ? kept_memory(job, total) : NULL;
    if (outcome == ACCEPTED && !bytes)
        outcome = refuse(job, "no memory for a state of %lu bytes", (unsigned long)total);
    if (bytes) {
        memcpy(bytes, &contents, sizeof contents);
        bytes += sizeof contents;
    }
    for (int role = 0; role < PARTS; role++) {
        if (bytes) {
            snapshot_to_bytes(job, snapshots[role], bytes, (size_t)contents.size[role]);
            bytes += contents.size[role];
        }
        snapshot_free(&snapshots[role]);
    }
    return outcome;
}

size_t variable_of(const Instance *instance, const char *name) {
    const VariableTable *table = instance->model->table;
    size_t variable = 0;
    while (variable < table->count && strcmp(table->variables[variable].name, name) != 0)
        variable++;
    return variable;
}

const void *read_part(const JobParts *parts, PartRole role, const char *name) {
    Instance *part = parts->part[role];
    return values_of(part, variable_of(part, name));
}

int32_t part_integer(const JobParts *parts, PartRole role, const char *name) {
    return *(const int32_t *)read_part(parts, role, name);
}

Outcome set_part(Instance *job, const JobParts *parts, PartRole role, const char *name, const void *values) {
    Instance *part = parts->part[role];
    const size_t variable = variable_of(part, name);
    const Span whole = {variable, 0, value_count(part, variable)};
    if (check_values(part, whole, values) != ACCEPTED)
        return refuse_for_part(job, parts, role);
    write_values(part, whole, values);
    return ACCEPTED;
}
