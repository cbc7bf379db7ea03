/* The file of an exported FMU with its parameters, in little-endian binary, because hosts change the locale that text
 * would be read with. Reading any file gives either parameters, each checked as an importer's value would be, or a
 * message. */
#ifndef INKLOOP_PARAMETER_FILE_H
#define INKLOOP_PARAMETER_FILE_H

#include "storage.h"

/* Rest of a file; name and command (that writes it) are for messages. */
typedef struct {
    const char *name, *command;
    const unsigned char *at;
    size_t left;
} ParameterFile;

/* The parameters of one model, which are skipped and read once their owner exists. */
typedef struct {
    char model[33];
    char fingerprint[17];
    uint64_t count;
    ParameterFile parameters;
} ParameterSection;

/* Reads everything before the sections, for the grid of an instance and the mark in its token, if it has one. */
Outcome check_head(Instance *whole, ParameterFile *from);

/* The next section; false if the file ends within it. */
bool take_section(ParameterFile *from, ParameterSection *section);

/* After the last section: refuses a file with more or less in it. */
Outcome check_end(Instance *whole, const ParameterFile *from, bool is_whole);

/* Refuses a section that is not of the model; `model` NULL: there is none of that name. `what`: its role. */
Outcome check_section(Instance *whole, const ParameterSection *section, const Model *model, const char *what);

/* Sets the parameters of `owner`, the instance itself or a part of it; messages are kept in `whole`. */
Outcome read_parameters(Instance *whole, Instance *owner, const ParameterSection *section);

#endif
