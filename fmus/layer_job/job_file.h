/* The file of a job: parameters of the job and of its parts, in little-endian binary, because hosts change the locale
 * that text would be read with. Reading any file gives either parts or a message. */
#ifndef INKLOOP_JOB_FILE_H
#define INKLOOP_JOB_FILE_H

#include "job_parts.h"

/* Sets the job's own parameters and makes its parts, every parameter checked as an importer's value would be. `mark` is
 * the file's check sum in the token of its FMU, "" if the token has none. If it refuses, it leaves no parts open. */
Outcome read_job(Instance *job, const unsigned char *bytes, size_t size, const char *mark, JobParts *parts);

#endif
