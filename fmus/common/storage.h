/* One instance of a model: its values in one block of memory, its mode and its messages. No FMI type, no global
 * variable. Above it: values.h, snapshot.h, lifecycle.h, the adapters of FMI 2 and 3. */
#ifndef INKLOOP_STORAGE_H
#define INKLOOP_STORAGE_H

#include "kernel.h"

/* Modes of an instance; bits, so that a call can be legal in several modes. */
typedef enum { INSTANTIATED = 1, CONFIGURATION = 2, INITIALIZATION = 4, STEP = 8, TERMINATED = 16, EVENT = 32 } Mode;
enum { BEFORE_STEP = INSTANTIATED | INITIALIZATION, INITIALIZED = STEP | EVENT };
enum { RUNNING = BEFORE_STEP | INITIALIZED, ANY_MODE = 63 };
enum { MESSAGE_SIZE = 512, MARK_SIZE = 16 };
enum { MAX_CELLS = 1 << 26 }; /* 8192 x 8192; a larger grid is more likely an error */
enum { TIME, NX, NY, DEPTH }; /* the first variables of every model; the last one of those that have MAPS */

struct Instance {
    const Model *model;
    Mode mode;
    bool has_scalar_references; /* FMI 2: every cell has a value reference; FMI 3: every variable */
    bool is_resizable;
    char mark[MARK_SIZE];                     /* end of the token, after the grid */
    char *resources;                          /* path of the folder; NULL if the importer names none */
    bool is_outdated;                         /* outputs must be calculated before they are read */
    uint64_t start_nx, start_ny, start_depth; /* of a new instance */
    uint64_t nx, ny, depth;                   /* size of the block; depth: number of maps in MAPS */
    unsigned char *block;                     /* all variables except the scratch ones */
    unsigned char *workplace;                 /* the scratch variables; NULL: not allocated */
    /* offsets of the variables in both, one after the other, 8-byte aligned, and their ends */
    size_t *offsets;
    size_t *first_references; /* first reference of each exposed variable, and the number of references */
    size_t saved_size;        /* bytes of the block */
    size_t last_found;        /* variable of the last reference that was looked up */
    unsigned char *kept;      /* kept_memory and scratch_memory of the kernel */
    unsigned char *scratch;
    size_t kept_size, scratch_size;
    struct Snapshot *before; /* all values before the present step, if `is_before_step_kept` */
    bool is_before_step_kept;
    char message[MESSAGE_SIZE];
};

bool is_possible_grid(uint64_t nx, uint64_t ny);

/* Whether a model has the structural parameter DEPTH. */
bool has_depth(const VariableTable *table);

/* A block for nx * ny cells and `depth` maps of MAPS with all start values; the memory that the instance had before is
 * not released. False, and nothing changed, if there is no memory. */
bool storage_allocate(Instance *instance, uint64_t nx, uint64_t ny, uint64_t depth);
void storage_release(Instance *instance);

/* Allocates the scratch variables for a step; false if there is no memory. Those of a large grid are released after
 * it. */
bool storage_take_workplace(Instance *instance);
void storage_give_workplace(Instance *instance);

/* Saves and restores the block: the variables with the states, without the scratch ones. */
void storage_save(const Instance *instance, void *bytes);
void storage_load(Instance *instance, const void *bytes);

size_t value_size(const VariableDefinition *definition);
size_t value_count(const Instance *instance, size_t variable);

/* Like refuse, for a call that the standard does not allow. */
#if defined(__GNUC__)
__attribute__((format(printf, 2, 3)))
#endif
Outcome misuse(Instance *instance, const char *format, ...);

/* MISUSED: an argument that the call requires is NULL. */
Outcome missing(Instance *instance, const char *argument);

/* "Instantiated", "Step Mode", ... */
const char *mode_name(Mode mode);

#endif
