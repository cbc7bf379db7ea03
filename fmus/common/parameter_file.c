#include "parameter_file.h"

#include "events.h"
#include "values.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* All numbers little-endian, offsets multiples of 8.
 *   0  "InkJob\r\n"   8  layout, 32 bit   12  CRC-32 of all from 16 on   16  nx   24  ny, 64 bit
 *  32  sections, each
 *        model, 32 bytes, the rest 0   fingerprint of its variables, 16 bytes   number of parameters, 64 bit, of which
 * each number of the variable, 64 bit   number of values, 64 bit   the values, 64 bit reals */
static const char MAGIC[8] = {'I', 'n', 'k', 'J', 'o', 'b', '\r', '\n'};
enum { LAYOUT = 1, CHECKED_FROM = 16, NAME_SIZE = 32, FINGERPRINT_SIZE = 16, WORD = 8, STRING_MAX = 1000 };
/* The next `size` bytes, NULL if there are not so many. */
static const unsigned char *take(ParameterFile *from, size_t size) {
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

static bool take_count(ParameterFile *from, uint64_t *count) {
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

static Outcome refuse_damaged(Instance *whole, const ParameterFile *file, const char *what) {
    return refuse(whole, "%s is damaged: %s; export it again (%s)", file->name, what, file->command);
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

/* A string has its bytes as values. */
static Outcome read_string(Instance *whole, Instance *owner, const ParameterFile *from, size_t variable,
                           const unsigned char *bytes, size_t count) {
    char text[STRING_MAX + 1] = "";
    for (size_t k = 0; k < count; k++) {
        const double value = count <= STRING_MAX ? real_of(bytes + k * WORD) : 0.0;
        if (!(value >= 1.0 && value <= UCHAR_MAX))
            return refuse_damaged(whole, from, "a value is no text");
        text[k] = (char)(unsigned char)value;
    }
    if (check_bytes(owner, TYPE_STRING, (uint32_t)variable, text, count) != ACCEPTED)
        return owner == whole ? REFUSED : refuse(whole, "%s: %s", owner->model->table->model, owner->message);
    write_bytes(owner, (uint32_t)variable, text, count);
    return ACCEPTED;
}

/* One parameter of the section of `owner`, the instance or a part of it. */
static Outcome read_parameter(Instance *whole, Instance *owner, ParameterFile *from) {
    const VariableTable *table = owner->model->table;
    uint64_t variable, count;
    if (!take_count(from, &variable) || !take_count(from, &count))
        return refuse_damaged(whole, from, "it ends within a parameter");
    const VariableDefinition *definition = &table->variables[variable < table->exposed_count ? variable : 0];
    const bool is_string = definition->type == TYPE_STRING;
    if (variable >= table->exposed_count || count > from->left / WORD || definition->type == TYPE_CLOCK ||
        definition->type == TYPE_BINARY || (!is_string && count != value_count(owner, (size_t)variable)))
        return refuse_damaged(whole, from, "a parameter has the wrong number or size");
    const Span span = {(size_t)variable, 0, (size_t)count};
    const unsigned char *bytes = take(from, (size_t)count * WORD);
    if (is_string)
        return read_string(whole, owner, from, (size_t)variable, bytes, (size_t)count);
    unsigned char *values = malloc((size_t)count * WORD);
    if (!values)
        return refuse(whole, "no memory for %s of %s", definition->name, table->model);
    Outcome outcome = ACCEPTED;
    for (size_t k = 0; k < span.count && outcome == ACCEPTED; k++)
        if (definition->type == TYPE_COUNT ||
            !store(definition->type, real_of(bytes + k * WORD), values + k * value_size(definition)))
            outcome = refuse_damaged(whole, from, "a value is not of the type of its parameter");
    if (outcome == ACCEPTED && check_values(owner, span, values) != ACCEPTED)
        outcome = owner == whole ? REFUSED : refuse(whole, "%s: %s", table->model, owner->message);
    if (outcome == ACCEPTED)
        write_values(owner, span, values);
    free(values);
    return outcome;
}

Outcome read_parameters(Instance *whole, Instance *owner, const ParameterSection *section) {
    ParameterFile from = section->parameters;
    Outcome outcome = ACCEPTED;
    for (uint64_t k = 0; k < section->count && outcome == ACCEPTED; k++)
        outcome = read_parameter(whole, owner, &from);
    return outcome;
}

bool take_section(ParameterFile *from, ParameterSection *section) {
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

Outcome check_section(Instance *owner, const ParameterSection *section, const Model *model, const char *what) {
    if (!model)
        return refuse(owner, "%s has a %s %s, which this binary does not know; export it again (%s)",
                      section->parameters.name, what, section->model, section->parameters.command);
    if (strcmp(section->model, model->table->model) == 0 &&
        strcmp(section->fingerprint, model->table->fingerprint) == 0)
        return ACCEPTED;
    return refuse(owner, "%s holds variables %s of %s, this binary %s of %s; export it again (%s)",
                  section->parameters.name, section->fingerprint, section->model, model->table->fingerprint,
                  model->table->model, section->parameters.command);
}

Outcome check_head(Instance *whole, ParameterFile *from) {
    const char *mark = whole->mark;
    const unsigned char *head = take(from, CHECKED_FROM), *grid = take(from, 2 * WORD);
    char sum[16];
    if (!head || !grid || memcmp(head, MAGIC, sizeof MAGIC) != 0)
        return refuse_damaged(whole, from, "it does not begin as one");
    if (unsigned_of(head + 8, 4) != LAYOUT)
        return refuse(whole, "%s is of layout %lu; this binary reads layout %d; export it again (%s)", from->name,
                      (unsigned long)unsigned_of(head + 8, 4), LAYOUT, from->command);
    const uint32_t expected = (uint32_t)unsigned_of(head + 12, 4);
    if (check_sum(grid, from->left + 2 * WORD) != expected)
        return refuse_damaged(whole, from, "its check sum is another one");
    snprintf(sum, sizeof sum, "%08lx", (unsigned long)expected);
    if (*mark != '\0' && strcmp(mark, sum) != 0)
        return refuse(whole, "%s has check sum %s, the token of the FMU has %s; they belong to different exports",
                      from->name, sum, mark);
    if (unsigned_of(grid, WORD) != whole->nx || unsigned_of(grid + WORD, WORD) != whole->ny)
        return refuse(whole, "%s is for %llu x %llu cells, the FMU for %llu x %llu; export it again (%s)", from->name,
                      (unsigned long long)unsigned_of(grid, WORD), (unsigned long long)unsigned_of(grid + WORD, WORD),
                      (unsigned long long)whole->nx, (unsigned long long)whole->ny, from->command);
    return ACCEPTED;
}

Outcome check_end(Instance *whole, const ParameterFile *from, bool is_whole) {
    return is_whole && from->left == 0 ? ACCEPTED : refuse_damaged(whole, from, "its sections do not fill it");
}
