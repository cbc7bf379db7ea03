#include "job_file.h"

#include "values.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* All numbers little-endian, offsets multiples of 8.
 *   0  "InkJob\r\n"   8  layout, 32 bit   12  CRC-32 of all from 16 on   16  nx   24  ny, 64 bit
 *  32  four sections, of the job, printer, profiler, controller, each
 *        model, 32 bytes, the rest 0   fingerprint of its variables, 16 bytes   number of parameters, 64 bit, of which
 * each number of the variable, 64 bit   number of values, 64 bit   the values, 64 bit reals */
static const char MAGIC[8] = {'I', 'n', 'k', 'J', 'o', 'b', '\r', '\n'};
enum { LAYOUT = 1, CHECKED_FROM = 16, NAME_SIZE = 32, FINGERPRINT_SIZE = 16, WORD = 8 };
static const char ADVICE[] = "export the job again (inkloop export job)";

typedef struct {
    const unsigned char *at;
    size_t left;
} Bytes;

/* The next `size` bytes, NULL if there are not so many. */
static const unsigned char *take(Bytes *from, size_t size) {
    if (from->left < size)
        return NULL;
    const unsigned char *taken = from->at;
    from->at += size;
    from->left -= size;
    return taken;
}

static uint64_t unsigned_of(const unsigned char *bytes, int count) {
    uint64_t value = 0;
    for (int k = count - 1; k >= 0; k--)
        value = value << 8 | bytes[k];
    return value;
}

static bool take_count(Bytes *from, uint64_t *count) {
    const unsigned char *bytes = take(from, WORD);
    *count = bytes ? unsigned_of(bytes, WORD) : 0;
    return bytes != NULL;
}

static double real_of(const unsigned char *bytes) {
    const uint64_t pattern = unsigned_of(bytes, WORD);
    double value;
    memcpy(&value, &pattern, sizeof value);
    return value;
}

/* CRC-32 of IEEE 802.3, four bits at a time. */
static uint32_t check_sum(const unsigned char *bytes, size_t size) {
    uint32_t table[16], sum = UINT32_MAX;
    for (uint32_t k = 0; k < 16; k++) {
        table[k] = k;
        for (int bit = 0; bit < 4; bit++)
            table[k] = table[k] >> 1 ^ (table[k] & 1 ? UINT32_C(0xEDB88320) : 0);
    }
    for (size_t k = 0; k < size; k++) {
        sum = sum >> 4 ^ table[(sum ^ bytes[k]) & 15];
        sum = sum >> 4 ^ table[(sum ^ (uint32_t)bytes[k] >> 4) & 15];
    }
    return ~sum;
}

static Outcome refuse_damaged(Instance *job, const char *what) {
    return refuse(job, "job.bin is damaged: %s; %s", what, ADVICE);
}

/* One value as the variable's type stores it; false if it is not a value of that type. */
static bool store(ValueType type, double value, unsigned char *place) {
    if (type == TYPE_REAL) {
        memcpy(place, &value, sizeof value);
        return true;
    }
    if (!(fabs(value) <= INT32_MAX) || value != floor(value) || (type == TYPE_BOOLEAN && value != 0.0 && value != 1.0))
        return false;
    const int32_t integer = (int32_t)value;
    const int64_t enumeration = integer;
    const bool boolean = integer != 0;
    if (type == TYPE_INTEGER)
        memcpy(place, &integer, sizeof integer);
    else if (type == TYPE_BOOLEAN)
        memcpy(place, &boolean, sizeof boolean);
    else
        memcpy(place, &enumeration, sizeof enumeration);
    return true;
}

/* One parameter of the section of `owner`, the job or a part. */
static Outcome read_parameter(Instance *job, Instance *owner, Bytes *from) {
    const VariableTable *table = owner->model->table;
    uint64_t variable, count;
    if (!take_count(from, &variable) || !take_count(from, &count))
        return refuse_damaged(job, "it ends within a parameter");
    if (variable >= table->exposed_count || count != value_count(owner, (size_t)variable) || count > from->left / WORD)
        return refuse_damaged(job, "a parameter has the wrong number or size");
    const VariableDefinition *definition = &table->variables[variable];
    const Span whole = {(size_t)variable, 0, (size_t)count};
    const unsigned char *bytes = take(from, (size_t)count * WORD);
    unsigned char *values = malloc((size_t)count * WORD);
    if (!values)
        return refuse(job, "no memory for %s of %s", definition->name, table->model);
    Outcome outcome = ACCEPTED;
    for (size_t k = 0; k < whole.count && outcome == ACCEPTED; k++)
        if (definition->type == TYPE_COUNT ||
            !store(definition->type, real_of(bytes + k * WORD), values + k * value_size(definition)))
            outcome = refuse_damaged(job, "a value is not of the type of its parameter");
    if (outcome == ACCEPTED && check_values(owner, whole, values) != ACCEPTED)
        outcome = owner == job ? REFUSED : refuse(job, "%s: %s", table->model, owner->message);
    if (outcome == ACCEPTED)
        write_values(owner, whole, values);
    free(values);
    return outcome;
}

static Outcome read_parameters(Instance *job, Instance *owner, Bytes from, uint64_t count) {
    Outcome outcome = ACCEPTED;
    for (uint64_t k = 0; k < count && outcome == ACCEPTED; k++)
        outcome = read_parameter(job, owner, &from);
    return outcome;
}

/* A section without its parameters, which are skipped and read once its owner exists. */
typedef struct {
    char model[NAME_SIZE + 1];
    char fingerprint[FINGERPRINT_SIZE + 1];
    uint64_t count;
    Bytes parameters;
} Section;

static bool take_section(Bytes *from, Section *section) {
    const unsigned char *model = take(from, NAME_SIZE), *fingerprint = take(from, FINGERPRINT_SIZE);
    if (!model || !fingerprint || !take_count(from, &section->count))
        return false;
    memcpy(section->model, model, NAME_SIZE);
    memcpy(section->fingerprint, fingerprint, FINGERPRINT_SIZE);
    section->model[NAME_SIZE] = section->fingerprint[FINGERPRINT_SIZE] = '\0';
    section->parameters = *from;
    for (uint64_t k = 0; k < section->count; k++) {
        uint64_t variable, count;
        if (!take_count(from, &variable) || !take_count(from, &count) || count > from->left / WORD ||
            !take(from, (size_t)count * WORD))
            return false;
    }
    return true;
}

static Outcome check_section(Instance *job, const Section *section, const Model *model, const char *what) {
    if (!model)
        return refuse(job, "job.bin has a %s %s, which this binary does not know; %s", what, section->model, ADVICE);
    if (strcmp(section->model, model->table->model) == 0 &&
        strcmp(section->fingerprint, model->table->fingerprint) == 0)
        return ACCEPTED;
    return refuse(job, "job.bin holds variables %s of %s, this binary %s of %s; %s", section->fingerprint,
                  section->model, model->table->fingerprint, model->table->model, ADVICE);
}

/* Everything before the sections; afterwards `from` is at the first section. */
static Outcome check_head(Instance *job, Bytes *from, const char *mark) {
    const unsigned char *head = take(from, CHECKED_FROM), *grid = take(from, 2 * WORD);
    char sum[16];
    if (!head || !grid || memcmp(head, MAGIC, sizeof MAGIC) != 0)
        return refuse_damaged(job, "it does not begin as one");
    if (unsigned_of(head + 8, 4) != LAYOUT)
        return refuse(job, "job.bin is of layout %lu; this binary reads layout %d; %s",
                      (unsigned long)unsigned_of(head + 8, 4), LAYOUT, ADVICE);
    const uint32_t expected = (uint32_t)unsigned_of(head + 12, 4);
    if (check_sum(grid, from->left + 2 * WORD) != expected)
        return refuse_damaged(job, "its check sum is another one");
    snprintf(sum, sizeof sum, "%08lx", (unsigned long)expected);
    if (*mark != '\0' && strcmp(mark, sum) != 0)
        return refuse(job, "job.bin has check sum %s, the token of the FMU has %s; they belong to different exports",
                      sum, mark);
    if (unsigned_of(grid, WORD) != job->nx || unsigned_of(grid + WORD, WORD) != job->ny)
        return refuse(job, "job.bin is for %llu x %llu cells, the FMU for %llu x %llu; %s",
                      (unsigned long long)unsigned_of(grid, WORD), (unsigned long long)unsigned_of(grid + WORD, WORD),
                      (unsigned long long)job->nx, (unsigned long long)job->ny, ADVICE);
    return ACCEPTED;
}

Outcome read_job(Instance *job, const unsigned char *bytes, size_t size, const char *mark, JobParts *parts) {
    Bytes from = {bytes, size};
    Section own, sections[PARTS];
    const Model *models[PARTS];
    *parts = (JobParts){{NULL}};
    Outcome outcome = check_head(job, &from, mark);
    if (outcome != ACCEPTED)
        return outcome;
    bool is_whole = take_section(&from, &own);
    for (int role = 0; role < PARTS && is_whole; role++)
        is_whole = take_section(&from, &sections[role]);
    if (!is_whole || from.left != 0)
        return refuse_damaged(job, "its sections do not fill it");
    outcome = check_section(job, &own, job->model, "job");
    for (int role = 0; role < PARTS && outcome == ACCEPTED; role++) {
        models[role] = model_of_role((PartRole)role, sections[role].model);
        outcome = check_section(job, &sections[role], models[role], role_name((PartRole)role));
    }
    if (outcome == ACCEPTED)
        outcome = read_parameters(job, job, own.parameters, own.count);
    if (outcome == ACCEPTED)
        outcome = create_parts(job, models, parts);
    for (int role = 0; role < PARTS && outcome == ACCEPTED; role++)
        outcome = read_parameters(job, parts->part[role], sections[role].parameters, sections[role].count);
    if (outcome != ACCEPTED)
        close_parts(parts);
    return outcome;
}
