/* One instance with the invariants around every call: a call does what the state machine of the standard demands, or it
 * is refused with a message and everything is as it was, bit by bit. */
#ifndef INKLOOP_FUZZ_SUBJECT_H
#define INKLOOP_FUZZ_SUBJECT_H

#include "fmu.h"

typedef enum { INSTANTIATED = 1, CONFIGURATION = 2, INITIALIZATION = 4, STEP = 8, TERMINATED = 16, EVENT = 32 } Mode;
enum { BEFORE_STEP = INSTANTIATED | INITIALIZATION, INITIALIZED = STEP | EVENT };
enum { RUNNING = BEFORE_STEP | INITIALIZED, ANY_MODE = 63 };

/* A serialized state; no bytes where none could be saved. */
typedef struct {
    unsigned char *bytes;
    size_t size;
} Saved;

typedef struct {
    const Fmu *fmu;
    void *instance;
    Log log;
    Mode mode;
    uint64_t nx, ny, depth;
    double now;   /* where the next step begins */
    bool waits;   /* a clock ticks: Event Mode comes before the next step */
    Saved before; /* the state after the last call */
    unsigned steps, layers, refusals;
} Subject;

/* The permitted outcome of a call, by its arguments according to the standard and the table. */
typedef enum {
    SUCCEEDS,     /* it is legal and sensible */
    MAY_BE_TAKEN, /* it is legal; the model decides */
    IS_REFUSED,   /* legal, with a value that the table excludes: any refusal */
    IS_MISUSED    /* an error */
} Verdict;

void subject_open(Subject *subject, const Fmu *fmu);
void subject_close(Subject *subject);

/* Before a call, and with its status after it; true if it succeeded. */
void subject_begin(Subject *subject);
bool subject_end(Subject *subject, const char *call, Verdict verdict, Status status);

/* The same for a call that leads into a mode. */
bool subject_to_mode(Subject *subject, const char *call, Verdict verdict, Status status, Mode mode);

Verdict legal_in(const Subject *subject, unsigned modes, Verdict if_legal);

bool subject_enter(Subject *subject, double start);
bool subject_exit(Subject *subject);
bool subject_step(Subject *subject, double start, double step);
bool subject_terminate(Subject *subject);
bool subject_reset(Subject *subject);
bool subject_configure(Subject *subject, bool enters);
void subject_resize(Subject *subject, double nx, double ny);

size_t value_count(const Subject *subject, const Variable *variable);

/* The first value of a variable, and every value of it from a list that is repeated; both are legal where called. */
double subject_get(Subject *subject, const Variable *variable);
bool subject_set(Subject *subject, const Variable *variable, const double values[], size_t count);

/* The present state as bytes; both are equal: */
Saved subject_save(Subject *subject);
bool is_same(const Saved *one, const Saved *other);

/* Inputs with which the next step has something to do, different for each `seed`; false if one was refused. */
bool subject_offer(Subject *subject, unsigned seed);

void demand(const Subject *subject, const char *call, bool holds, const char *invariant);

#endif
