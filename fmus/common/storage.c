#include "storage.h"

#include "red_zones.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ALIGNMENT = 8 };
enum { LARGE_WORKPLACE = 1 << 20 }; /* bytes above which the workplace is allocated anew for each step (assumed) */

static void write_message(char message[MESSAGE_SIZE], const char *format, va_list arguments) {
    vsnprintf(message, MESSAGE_SIZE, format, arguments);
}

Outcome refuse(Instance *instance, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    write_message(instance->message, format, arguments);
    va_end(arguments);
    return REFUSED;
}

Outcome misuse(Instance *instance, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    write_message(instance->message, format, arguments);
    va_end(arguments);
    return MISUSED;
}

Outcome missing(Instance *instance, const char *argument) {
    return misuse(instance, "%s is NULL", argument);
}

const char *mode_name(Mode mode) {
    switch (mode) {
    case INSTANTIATED:
        return "Instantiated";
    case CONFIGURATION:
        return "Configuration Mode";
    case INITIALIZATION:
        return "Initialization Mode";
    case STEP:
        return "Step Mode";
    case EVENT:
        return "Event Mode";
    case TERMINATED:
        return "Terminated";
    }
    return "no mode";
}

size_t value_size(const VariableDefinition *definition) {
    static const size_t SIZES[] = {sizeof(double),  sizeof(int32_t),  sizeof(bool),
                                   sizeof(int64_t), sizeof(uint64_t), sizeof(bool)};
    if (definition->type == TYPE_STRING || definition->type == TYPE_BINARY)
        return sizeof(ByteString) + (size_t)definition->max + 1;
    return SIZES[definition->type];
}

size_t value_count(const Instance *instance, size_t variable) {
    const Shape shape = instance->model->table->variables[variable].shape;
    const size_t maps = shape == MAPS ? (size_t)instance->depth : 1;
    return shape == ONE_VALUE ? 1 : maps * (size_t)(instance->nx * instance->ny);
}

/* Address of an offset; NULL for one of scratch variables that are not allocated. */
static unsigned char *place_of(const Instance *instance, size_t offset) {
    if (offset < instance->saved_size)
        return instance->block + offset;
    return instance->workplace ? instance->workplace + (offset - instance->saved_size) : NULL;
}

void *values_of(Instance *instance, size_t variable) {
    return place_of(instance, instance->offsets[variable]);
}

/* Reallocates `*memory`; NULL if the size is 0, and NULL, with nothing changed, if there is no memory. */
static void *resized(unsigned char **memory, size_t *present, size_t size) {
    if (*memory && *present == size)
        return *memory;
    unsigned char *fresh = size == 0 ? NULL : calloc(size, 1);
    if (!fresh && size > 0)
        return NULL;
    free(*memory);
    *memory = fresh;
    *present = size;
    return fresh;
}

void *kept_memory(Instance *instance, size_t size) {
    return resized(&instance->kept, &instance->kept_size, size);
}

void *scratch_memory(Instance *instance, size_t size) {
    return resized(&instance->scratch, &instance->scratch_size, size);
}

static void fill(Instance *instance, size_t variable) {
    const VariableDefinition *definition = &instance->model->table->variables[variable];
    unsigned char *values = values_of(instance, variable);
    union {
        double real;
        int32_t integer;
        bool boolean;
        int64_t enumeration;
        uint64_t count;
    } start;
    memset(&start, 0, sizeof start);
    switch (definition->type) {
    case TYPE_REAL:
        start.real = definition->start;
        break;
    case TYPE_INTEGER:
        start.integer = (int32_t)definition->start;
        break;
    case TYPE_BOOLEAN:
        start.boolean = definition->start != 0.0;
        break;
    case TYPE_ENUMERATION:
        start.enumeration = (int64_t)definition->start;
        break;
    case TYPE_COUNT:
        start.count = (uint64_t)definition->start;
        break;
    case TYPE_CLOCK:
    case TYPE_STRING:
    case TYPE_BINARY:
        break; /* silent, and empty */
    }
    const size_t size = value_size(definition);
    if (definition->start == 0.0)
        return; /* fresh memory is zero already, and writing would use its pages */
    for (size_t k = 0; k < value_count(instance, variable); k++)
        memcpy(values + k * size, &start, size);
}

/* In sanitizer builds: forbids access between the end of a variable and the next one. */
static void poison_red_zones(const Instance *instance, Causality causality, bool is_poisoned) {
    const VariableTable *table = instance->model->table;
    for (size_t k = 0; k < table->count; k++) {
        const size_t bytes = value_count(instance, k) * value_size(&table->variables[k]);
        const size_t length = instance->offsets[k + 1] - instance->offsets[k];
        if ((table->variables[k].causality == SCRATCH) == (causality == SCRATCH))
            set_red_zone(place_of(instance, instance->offsets[k]) + bytes, length - bytes, is_poisoned);
    }
}

static size_t workplace_size(const Instance *instance) {
    return instance->offsets[instance->model->table->count] - instance->saved_size;
}

bool storage_take_workplace(Instance *instance) {
    if (instance->workplace || workplace_size(instance) == 0)
        return true;
    instance->workplace = calloc(workplace_size(instance), 1);
    if (instance->workplace)
        poison_red_zones(instance, SCRATCH, true);
    return instance->workplace != NULL;
}

void storage_give_workplace(Instance *instance) {
    if (workplace_size(instance) < LARGE_WORKPLACE)
        return;
    free(instance->workplace);
    instance->workplace = NULL;
}

bool storage_allocate(Instance *instance, uint64_t nx, uint64_t ny, uint64_t depth) {
    const VariableTable *table = instance->model->table;
    Instance sized = *instance;
    sized.nx = nx;
    sized.ny = ny;
    sized.depth = depth;
    sized.offsets = malloc((table->count + 1) * sizeof *sized.offsets);
    sized.first_references = malloc((table->exposed_count + 1) * sizeof *sized.first_references);
    sized.block = NULL;
    if (sized.offsets && sized.first_references) {
        size_t end = 0, reference = 0;
        sized.saved_size = 0;
        for (size_t k = 0; k < table->count; k++) {
            const size_t size = value_count(&sized, k) * value_size(&table->variables[k]);
            sized.offsets[k] = end;
            if (k < table->exposed_count) {
                sized.first_references[k] = reference;
                reference += sized.has_scalar_references ? value_count(&sized, k) : 1;
            }
            end += (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT + RED_ZONE;
            if (table->variables[k].causality != SCRATCH)
                sized.saved_size = end;
        }
        sized.offsets[table->count] = end;
        sized.first_references[table->exposed_count] = reference;
        sized.block = calloc(sized.saved_size, 1);
    }
    sized.workplace = NULL;
    if (!sized.block || (workplace_size(&sized) < LARGE_WORKPLACE && !storage_take_workplace(&sized))) {
        free(sized.block);
        free(sized.offsets);
        free(sized.first_references);
        return false;
    }
    sized.last_found = 0;
    sized.kept = sized.scratch = NULL;
    sized.kept_size = sized.scratch_size = 0;
    sized.before = NULL;
    *instance = sized;
    poison_red_zones(instance, STATE, true);
    for (size_t k = 0; k < table->count; k++)
        fill(instance, k);
    *(uint64_t *)values_of(instance, NX) = nx;
    *(uint64_t *)values_of(instance, NY) = ny;
    if (has_depth(table))
        *(uint64_t *)values_of(instance, DEPTH) = depth;
    instance->is_outdated = true;
    return true;
}

void storage_release(Instance *instance) {
    free(instance->block);
    free(instance->workplace);
    free(instance->offsets);
    free(instance->first_references);
    free(instance->kept);
    free(instance->scratch);
    free(instance->before);
}

bool has_depth(const VariableTable *table) {
    return table->count > DEPTH && table->variables[DEPTH].causality == STRUCTURAL;
}

bool is_possible_grid(uint64_t nx, uint64_t ny) {
    return nx >= 1 && ny >= 1 && nx <= MAX_CELLS && ny <= MAX_CELLS / nx;
}

void storage_save(const Instance *instance, void *bytes) {
    poison_red_zones(instance, STATE, false);
    memcpy(bytes, instance->block, instance->saved_size);
    poison_red_zones(instance, STATE, true);
}

void storage_load(Instance *instance, const void *bytes) {
    enum { PIECE = 4096 };
    const size_t size = instance->saved_size;
    poison_red_zones(instance, STATE, false);
    for (size_t at = 0, count; at < size; at += count) {
        unsigned char *own = instance->block + at;
        const unsigned char *saved = (const unsigned char *)bytes + at;
        count = size - at < PIECE ? size - at : PIECE;
        if (memcmp(own, saved, count) != 0) /* equal memory is not written, which would use its pages */
            memcpy(own, saved, count);
    }
    poison_red_zones(instance, STATE, true);
}
