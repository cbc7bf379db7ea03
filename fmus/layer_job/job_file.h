/* The file of a job: a parameter file with the sections of job, printer, profiler and controller. */
#ifndef INKLOOP_JOB_FILE_H
#define INKLOOP_JOB_FILE_H

#include "job_parts.h"

/* Sets the job's own parameters and makes its parts. If it refuses, it leaves no parts open. */
Outcome read_job(Instance *job, const unsigned char *bytes, size_t size, JobParts *parts);

#endif
