/* One instance of a model: values, life cycle, messages, saved states. No FMI type, no global variable. */
#ifndef INKLOOP_INSTANCE_H
#define INKLOOP_INSTANCE_H

#include "kernel.h"

/* The model that an FMU offers; a kernel may stand on others beside it. */
extern const Model *const FMU_MODEL;

/* Where an instance is in its life; bits, so that a call is legal in a set of modes. */
typedef enum { INSTANTIATED = 1, CONFIGURATION = 2, INITIALIZATION = 4, STEP = 8, TERMINATED = 16 } Mode;
enum { BEFORE_STEP = INSTANTIATED | INITIALIZATION, RUNNING = BEFORE_STEP | STEP, ANY_MODE = 31 };
enum { MESSAGE_SIZE = 512, MARK_SIZE = 16 };

struct Instance {
    const Model *model;
    Mode mode;
    bool has_scalar_references; /* FMI 2: every cell has a value reference; FMI 3: every variable */
    bool is_resizable;
    char mark[MARK_SIZE];        /* what the token says after the grid */
    char *resources;             /* path of the folder; NULL if the importer names none */
    bool is_outdated;            /* outputs must be calculated before they are read */
    uint64_t start_nx, start_ny; /* grid of a new instance */
    uint64_t nx, ny;             /* grid of the block */
    unsigned char *block;
    size_t *offsets;          /* of the variables in the block, 8-byte aligned, and its end */
    size_t *first_references; /* of the exposed variables, and the number of references */
    size_t saved_size;        /* bytes of the block before the scratch variables */
    size_t last_found;        /* variable of the last reference that was looked up */
    unsigned char *kept;      /* what the kernel keeps beside the block, and its scratch memory */
    unsigned char *scratch;
    size_t kept_size, scratch_size;
    struct Snapshot *before; /* all values before the present step, if `is_before_step_kept` */
    bool is_before_step_kept;
    char message[MESSAGE_SIZE];
};

/* The token is "Model-fingerprint-NXxNY", with "-resizable" at the end where nx and ny can be set, or a mark of what
 * the model's resources hold (see model_definition.py); `resources` is the path of their folder or NULL. NULL on
 * failure, with the reason in `message`. */
Instance *instance_create(const Model *model, const char *token, bool has_scalar_references, const char *resources,
                          char message[MESSAGE_SIZE]);
void instance_free(Instance *instance);

/* Everything as in a new instance. */
Outcome instance_reset(Instance *instance);

Outcome instance_enter_configuration(Instance *instance);
Outcome instance_exit_configuration(Instance *instance);
Outcome instance_enter_initialization(Instance *instance, double start_time);
Outcome instance_exit_initialization(Instance *instance);
Outcome instance_do_step(Instance *instance, double start, double step);
double instance_time(Instance *instance);

/* Like refuse, for a call that the standard does not allow. */
#if defined(__GNUC__)
__attribute__((format(printf, 2, 3)))
#endif
Outcome misuse(Instance *instance, const char *format, ...);

/* MISUSED if one is none of those that the descriptions name. */
Outcome check_categories(Instance *instance, size_t count, const char *const categories[]);

/* MISUSED: an argument that the call cannot do without is NULL. */
Outcome missing(Instance *instance, const char *argument);

/* "Instantiated", "Step Mode", ... */
const char *mode_name(Mode mode);

size_t value_size(ValueType type);
size_t value_count(const Instance *instance, size_t variable);

/* values.c: what one value reference stands for, a whole variable or one cell of it. */
typedef struct {
    size_t variable, first, count;
} Span;

Outcome find_span(Instance *instance, uint32_t reference, Span *span);

/* MISUSED if it cannot be set now, REFUSED if a value is not taken; `values` are of the variable's own type. */
Outcome check_values(Instance *instance, Span span, const void *values);
void write_values(Instance *instance, Span span, const void *values);
const void *read_values(Instance *instance, Span span);

/* Calculates the outputs if something was set before the first step that they may depend on. */
void update_outputs(Instance *instance);

/* MISUSED if a call that names `count` variables comes without references or values. */
Outcome check_arrays(Instance *instance, const void *references, const void *values, size_t count);

/* Several references of one type at once, all or nothing. */
Outcome get_values(Instance *instance, ValueType type, const uint32_t references[], size_t count, void *values,
                   size_t value_total);
Outcome set_values(Instance *instance, ValueType type, const uint32_t references[], size_t count, const void *values,
                   size_t value_total);

/* snapshot.c: the whole state, bit by bit. */
typedef struct Snapshot {
    size_t size;
    unsigned char bytes[];
} Snapshot;

/* `*snapshot` may hold an older snapshot of the same size, which is reused, or be NULL. */
Outcome snapshot_take(Instance *instance, Snapshot **snapshot);
Outcome snapshot_copy(Instance *instance, Snapshot **snapshot); /* to go back to only: without its checksum */
Outcome snapshot_restore(Instance *instance, const Snapshot *snapshot);
Outcome snapshot_from_bytes(Instance *instance, const void *bytes, size_t size, Snapshot **snapshot);

#endif
