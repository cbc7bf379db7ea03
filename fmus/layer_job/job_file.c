#include "job_file.h"

#include "parameter_file.h"

Outcome read_job(Instance *job, const unsigned char *bytes, size_t size, JobParts *parts) {
    ParameterFile from = {"job.bin", "inkloop export job", bytes, size};
    ParameterSection own, sections[PARTS];
    const Model *models[PARTS];
    *parts = (JobParts){{NULL}};
    Outcome outcome = check_head(job, &from);
    if (outcome != ACCEPTED)
        return outcome;
    bool is_whole = take_section(&from, &own);
    for (int role = 0; role < PARTS && is_whole; role++)
        is_whole = take_section(&from, &sections[role]);
    outcome = check_end(job, &from, is_whole);
    if (outcome != ACCEPTED)
        return outcome;
    outcome = check_section(job, &own, job->model, "job");
    for (int role = 0; role < PARTS && outcome == ACCEPTED; role++) {
        models[role] = model_of_role((PartRole)role, sections[role].model);
        outcome = check_section(job, &sections[role], models[role], role_name((PartRole)role));
    }
    if (outcome == ACCEPTED)
        outcome = read_parameters(job, job, &own);
    if (outcome == ACCEPTED)
        outcome = create_parts(job, models, parts);
    for (int role = 0; role < PARTS && outcome == ACCEPTED; role++)
        outcome = read_parameters(job, parts->part[role], &sections[role]);
    if (outcome != ACCEPTED)
        close_parts(parts);
    return outcome;
}
