/* An FMU as the fuzz target and the threads see it, whatever its version: a library with calls, and a table of
 * variables that tests/support/fmus/fmu_library.py writes. */
#ifndef INKLOOP_FUZZ_FMU_H
#define INKLOOP_FUZZ_FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { OK, WARNING, DISCARD, ERROR }; /* the same numbers in both versions */
typedef unsigned Status;              /* as gcc and clang count in enumerations */
enum { NAME_SIZE = 64, TEXT_SIZE = 768, VARIABLES_MAX = 128 };

/* Messages of an instance since `count` was set to 0. */
typedef struct {
    unsigned count;
    char text[TEXT_SIZE];
} Log;

enum { ONE_VALUE, MAP, MAPS }; /* shapes */

/* type: r real, i integer, b Boolean, e enumeration, c count, and without numbers k clock, s string, y binary; role: i
 * input, p parameter, t tunable parameter, s structural parameter, - not settable. A map has nx * ny values, maps
 * `depth` times as many; in FMI 2 each value has a reference, from the first on. */
typedef struct {
    char name[NAME_SIZE], type, role;
    int shape;
    uint32_t reference;
    double start, min, max;
    double most_tried; /* of what only means more work */
} Variable;

/* The calls of Event Mode, and of what is no number. */
typedef struct {
    Status (*enter)(void *instance);
    Status (*leave)(void *instance);
    Status (*update)(void *instance, bool *again);
    Status (*get_clock)(void *instance, uint32_t reference, bool *ticks);
    Status (*set_clock)(void *instance, uint32_t reference, bool ticks);
    Status (*get_binary)(void *instance, uint32_t reference, size_t *size, const uint8_t **bytes);
    Status (*set_binary)(void *instance, uint32_t reference, size_t size, const uint8_t *bytes);
    Status (*set_string)(void *instance, uint32_t reference, const char *text);
} EventCalls;

/* The calls of one version. */
typedef struct {
    bool (*load)(void *library);
    void *(*instantiate)(const char *token, const char *resources, bool with_events, Log *log);
    void (*release)(void *instance);
    char (*kind)(char type); /* the type whose functions access it */
    size_t (*value_size)(char kind);
    double (*encode)(char kind, double number, void *value); /* the number that it became */
    double (*decode)(char kind, const void *value);
    Status (*get)(void *instance, char kind, const uint32_t references[], size_t count, void *values, size_t total);
    Status (*set)(void *instance, char kind, const uint32_t references[], size_t count, const void *values,
                  size_t total);
    Status (*enter)(void *instance, double start);
    Status (*exit)(void *instance);
    Status (*step)(void *instance, double start, double step, bool *event);
    Status (*terminate)(void *instance);
    Status (*reset)(void *instance);
    Status (*configure)(void *instance, bool enters); /* NULL: this version has no Configuration Mode */
    Status (*get_state)(void *instance, void **state);
    Status (*set_state)(void *instance, void *state);
    Status (*free_state)(void *instance, void **state);
    Status (*state_size)(void *instance, void *state, size_t *size);
    Status (*serialize)(void *instance, void *state, unsigned char *bytes, size_t size);
    Status (*deserialize)(void *instance, const unsigned char *bytes, size_t size, void **state);
    Status (*set_categories)(void *instance, size_t count, const char *const categories[]);
    const EventCalls *events; /* NULL: this version has no Event Mode */
} Version;

extern const Version VERSION_2, VERSION_3;

typedef struct {
    const Version *version;
    char library[TEXT_SIZE], resources[TEXT_SIZE], token[TEXT_SIZE];
    bool is_resizable, has_scalar_references, has_events;
    uint64_t nx, ny, depth;
    size_t variable_count;
    Variable variables[VARIABLES_MAX];
} Fmu;

/* Reads the table and opens the library; ends the process, with a sentence, if it cannot. */
void fmu_open(Fmu *fmu, const char *table);

/* The variable of this name, NULL if there is none; `role` 0: of any. */
const Variable *fmu_variable(const Fmu *fmu, const char *name, char role);

#endif
