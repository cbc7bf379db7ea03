#include "fmu.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shared_library.h"

static void give_up(const char *what, const char *which) {
    fprintf(stderr, "%s: %s\n", which, what);
    exit(2);
}

static void read_line(FILE *file, char line[TEXT_SIZE], const char *table) {
    if (!fgets(line, TEXT_SIZE, file))
        give_up("ends too early", table);
    line[strcspn(line, "\n")] = '\0';
}

static void read_variables(Fmu *fmu, FILE *file, const char *table) {
    char line[TEXT_SIZE];
    for (; fgets(line, sizeof line, file); fmu->variable_count++) {
        if (fmu->variable_count == VARIABLES_MAX)
            give_up("has more variables than there is room for", table);
        Variable *v = &fmu->variables[fmu->variable_count];
        if (sscanf(line, "%63s %c %c %d %" SCNu32 " %lf %lf %lf %lf", v->name, &v->type, &v->role, &v->shape,
                   &v->reference, &v->start, &v->min, &v->max, &v->most_tried) != 9)
            give_up(line, table);
        fmu->has_events = fmu->has_events || v->type == 'k';
    }
}

void fmu_open(Fmu *fmu, const char *table) {
    char line[TEXT_SIZE];
    int version = 0, is_resizable = 0;
    FILE *file = table ? fopen(table, "r") : NULL;
    if (!file)
        give_up("cannot be read; tests/support/fmus/fmu_library.py writes it", table ? table : "no table of variables");
    memset(fmu, 0, sizeof *fmu);
    read_line(file, line, table);
    if (sscanf(line, "%d %d %" SCNu64 " %" SCNu64 " %" SCNu64, &version, &is_resizable, &fmu->nx, &fmu->ny,
               &fmu->depth) != 5)
        give_up(line, table);
    read_line(file, fmu->library, table);
    read_line(file, fmu->resources, table);
    read_line(file, fmu->token, table);
    read_variables(fmu, file, table);
    fclose(file);
    fmu->is_resizable = is_resizable != 0;
    fmu->has_scalar_references = version == 2;
    fmu->version = version == 2 ? &VERSION_2 : &VERSION_3;
    void *library = open_library(fmu->library);
    if (!library || !fmu->version->load(library))
        give_up(dlerror(), fmu->library);
}

const Variable *fmu_variable(const Fmu *fmu, const char *name, char role) {
    for (size_t k = 0; k < fmu->variable_count; k++)
        if (strcmp(fmu->variables[k].name, name) == 0 && (role == 0 || fmu->variables[k].role == role))
            return &fmu->variables[k];
    return NULL;
}
