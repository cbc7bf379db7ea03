/* The three models that a job is made of, as instances of their own. Between two steps a job keeps their states only,
 * one after the other in its kept memory; a call that needs the parts opens them and, on success, keeps them. */
#ifndef INKLOOP_JOB_PARTS_H
#define INKLOOP_JOB_PARTS_H

#include "lifecycle.h"

typedef enum { PRINTER, PROFILER, CONTROLLER, PARTS } PartRole;

typedef struct {
    Instance *part[PARTS];
} JobParts;

/* The model of a role by its name, NULL if the role has none of that name. */
const Model *model_of_role(PartRole role, const char *name);

/* "printer", ... */
const char *role_name(PartRole role);

/* New parts for the grid of the job; those of a failed call are closed. */
Outcome create_parts(Instance *job, const Model *const models[PARTS], JobParts *parts);

/* Opens the parts as they were kept. */
Outcome open_parts(Instance *job, JobParts *parts);
void close_parts(JobParts *parts);

/* Makes the present parts those of the job; if it refuses, nothing has changed. */
Outcome keep_parts(Instance *job, const JobParts *parts);

/* The number of a variable in the table of an instance, one of all parts of a role. */
size_t variable_of(const Instance *instance, const char *name);

/* Values of a variable of a part. */
const void *read_part(const JobParts *parts, PartRole role, const char *name);
int32_t part_integer(const JobParts *parts, PartRole role, const char *name);

/* Sets a variable of a part, checked as an importer's value would be; a refusal becomes the message of the job. */
Outcome set_part(Instance *job, const JobParts *parts, PartRole role, const char *name, const void *values);

/* Makes a refusal of a part the message of the job. */
Outcome refuse_for_part(Instance *job, const JobParts *parts, PartRole role);

#endif
