/* What a job prints, as a file: parameters of the job and of its parts, in little-endian binary, because hosts change
 * the locale that text would be read with. Whatever stands in the file, reading it ends in parts or in words. */
#ifndef INKLOOP_JOB_FILE_H
#define INKLOOP_JOB_FILE_H

#include "job_parts.h"

/* Sets the job's own parameters and makes its parts, every parameter checked as an importer's value would be. `mark` is
 * the file's check sum in the token of its FMU, "" if that says none. Refusing, it leaves no parts open. */
Outcome read_job(Instance *job, const unsigned char *bytes, size_t size, const char *mark, JobParts *parts);

#endif
