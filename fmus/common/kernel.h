/* Interface between the FMI adapters and the models, free of any FMI version.
 *
 * A model is a table of variables (generated from its variables.toml) and up to seven functions. An instance keeps all
 * values in one block of memory, so reading, writing and saving a model means walking the table; a kernel sees the
 * values through the struct of pointers in its generated header and uses no FMI type. One binary may contain several
 * models. */
#ifndef INKLOOP_KERNEL_H
#define INKLOOP_KERNEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum {
    TYPE_REAL,
    TYPE_INTEGER,
    TYPE_BOOLEAN,
    TYPE_ENUMERATION,
    TYPE_COUNT,
    TYPE_CLOCK,
    TYPE_STRING,
    TYPE_BINARY
} ValueType;

/* Value of a string or a binary; 0 follows its bytes. */
typedef struct ByteString {
    uint32_t size;
    unsigned char bytes[];
} ByteString;

/* The order of the table; TUNABLE parameters stand among the others; STATE is saved with the instance but not exposed,
 * SCRATCH neither. */
typedef enum { INDEPENDENT, STRUCTURAL, INPUT, OUTPUT, PARAMETER, TUNABLE, STATE, SCRATCH } Causality;

/* A map has nx * ny values in C order. Maps are several of them, one after the other; the structural parameter after nx
 * and ny is their number. */
typedef enum { ONE_VALUE, MAP, MAPS } Shape;

typedef struct {
    const char *name;
    ValueType type; /* stored as double, int32_t, bool, int64_t, uint64_t, bool: it ticks, ByteString */
    Causality causality;
    Shape shape;
    double start, min, max; /* reals must also be finite; max of a string or binary: most bytes */
    size_t clock;           /* number of the clock of a clocked variable; 0: not clocked */
} VariableDefinition;

typedef struct {
    const char *model;
    const char *fingerprint; /* changes with the table */
    const VariableDefinition *variables;
    size_t count, exposed_count; /* the exposed variables come first */
} VariableTable;

typedef enum {
    ACCEPTED,
    REFUSED, /* a value or command that the model does not accept; nothing has changed */
    MISUSED  /* a call that the standard does not allow here; nothing has changed */
} Outcome;

typedef struct Instance Instance;

/* Values of a variable by its number. */
void *values_of(Instance *instance, size_t variable);

/* Memory in addition to the variables, for data of other sizes: as large as last requested, and zeroed whenever that
 * size changes. The first is saved with the instance, the second is not. NULL if there is no memory. */
void *kept_memory(Instance *instance, size_t size);
void *scratch_memory(Instance *instance, size_t size);

/* Keeps all values as they are before a step changes them: if an output is not finite after it, they are restored and
 * the step is refused. False if there is no memory. */
bool keep_values(Instance *instance);

/* Keep the message "what was found; what was expected; what to do" for the log; `return refuse(...)`. */
#if defined(__GNUC__)
__attribute__((format(printf, 2, 3)))
#endif
Outcome refuse(Instance *instance, const char *format, ...);

/* The table and the functions that every kernel defines. */
typedef struct {
    const VariableTable *table;

    /* Start of a new or reset instance, which has its start values: reads resources of the model, which may change
     * them. NULL: there is nothing to read. */
    Outcome (*open)(Instance *instance);

    /* Allocates the memory of later steps: for a new or reset instance, and at the end of a configuration. Memory that
     * depends on values set later is allocated again in `initialize`. NULL: there are only the variables. */
    Outcome (*reserve)(Instance *instance);

    /* Further checks of one value, which is within the limits of the table; called before anything is written. NULL:
     * there are only the limits. */
    Outcome (*check_value)(Instance *instance, size_t variable, const void *value);

    /* Outputs at the start time from the present parameters and inputs; may be called many times before the first
     * step. */
    void (*calculate)(Instance *instance);

    /* End of initialisation: checks parameters against each other, takes inputs as references, sets state and
     * outputs. */
    Outcome (*initialize)(Instance *instance);

    /* One communication step with inputs held. If it refuses, it has changed nothing. */
    Outcome (*do_step)(Instance *instance, double start, double end);

    /* End of an instant of Event Mode: takes what came with the input clocks, clears what went with the output clocks,
     * and sets those that tick in the next instant. Initialisation and steps may set output clocks too. NULL: the model
     * has no clocks and no Event Mode. */
    Outcome (*update)(Instance *instance);
} Model;

#endif
