#include "subject.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CELLS_MAX = 128 };

void demand(const Subject *subject, const char *call, bool holds, const char *invariant) {
    if (holds)
        return;
    fprintf(stderr, "broken invariant, at %s in mode %d: %s\n  last message: %s\n", call, (int)subject->mode, invariant,
            subject->log.text);
    abort();
}

static const Version *version_of(const Subject *subject) {
    return subject->fmu->version;
}

Saved subject_save(Subject *s) {
    Saved saved = {NULL, 0};
    void *state = NULL;
    if (s->mode == CONFIGURATION) /* the standard allows no state there */
        return saved;
    demand(s, "save", version_of(s)->get_state(s->instance, &state) == OK, "a state can be taken");
    demand(s, "save", version_of(s)->state_size(s->instance, state, &saved.size) == OK, "it has a size");
    saved.bytes = malloc(saved.size);
    if (!saved.bytes)
        exit(2);
    const Status status = version_of(s)->serialize(s->instance, state, saved.bytes, saved.size);
    demand(s, "save", status == OK, "it can be serialized");
    demand(s, "save", version_of(s)->free_state(s->instance, &state) == OK && !state, "it can be freed");
    return saved;
}

bool is_same(const Saved *one, const Saved *other) {
    return one->size == other->size && (one->size == 0 || memcmp(one->bytes, other->bytes, one->size) == 0);
}

static void remember(Subject *s) {
    free(s->before.bytes);
    s->before = subject_save(s);
}

void subject_open(Subject *s, const Fmu *fmu) {
    *s = (Subject){.fmu = fmu, .mode = INSTANTIATED, .nx = fmu->nx, .ny = fmu->ny, .depth = fmu->depth};
    s->instance = fmu->version->instantiate(fmu->token, fmu->resources, fmu->has_events, &s->log);
    demand(s, "instantiate", s->instance != NULL, "there is an instance");
    remember(s);
}

void subject_close(Subject *s) {
    version_of(s)->release(s->instance);
    free(s->before.bytes);
}

void subject_begin(Subject *s) {
    s->log.count = 0;
    s->log.text[0] = '\0';
}

static void check_status(const Subject *s, const char *call, Verdict verdict, Status status) {
    demand(s, call, status == OK || status == DISCARD || status == ERROR, "the status is OK, discard or error");
    demand(s, call, verdict != IS_MISUSED || status != OK, "what the standard does not allow does not succeed");
    demand(s, call, verdict != IS_REFUSED || status != OK, "a value beyond its limits is not taken");
    demand(s, call, verdict != SUCCEEDS || status == OK, "what is legal and sensible succeeds");
    demand(s, call, (s->log.count == 0) == (status == OK), "a refusal is logged, with its status, and nothing else is");
    demand(s, call, status == OK || strlen(s->log.text) > 10, "a failure comes with a message");
}

bool subject_end(Subject *s, const char *call, Verdict verdict, Status status) {
    check_status(s, call, verdict, status);
    if (status == OK) {
        remember(s);
        return true;
    }
    Saved after = subject_save(s);
    demand(s, call, is_same(&s->before, &after), "a refusal changes nothing");
    free(after.bytes);
    s->refusals++;
    return false;
}

Verdict legal_in(const Subject *s, unsigned modes, Verdict if_legal) {
    return s->mode & modes ? if_legal : IS_MISUSED;
}

bool subject_to_mode(Subject *s, const char *call, Verdict verdict, Status status, Mode mode) {
    const Mode old = s->mode;
    s->mode = status == OK ? mode : old;
    return subject_end(s, call, verdict, status);
}

bool subject_enter(Subject *s, double start) {
    const Verdict verdict = legal_in(s, INSTANTIATED, isfinite(start) ? SUCCEEDS : IS_MISUSED);
    subject_begin(s);
    const bool is_done = subject_to_mode(s, "enter", verdict, version_of(s)->enter(s->instance, start), INITIALIZATION);
    s->now = is_done ? start : s->now;
    return is_done;
}

bool subject_exit(Subject *s) {
    subject_begin(s);
    const Mode next = s->fmu->has_events ? EVENT : STEP;
    s->waits = s->waits || (s->fmu->has_events && s->mode == INITIALIZATION);
    return subject_to_mode(s, "exit", legal_in(s, INITIALIZATION, MAY_BE_TAKEN), version_of(s)->exit(s->instance),
                           next);
}

bool subject_step(Subject *s, double start, double step) {
    const bool leads_on = isfinite(start) && isfinite(step) && isfinite(start + step) && start + step > start &&
                          start >= s->now - 1e-6 * step - 1e-12 * fabs(s->now);
    subject_begin(s);
    bool event = false;
    const Status status = version_of(s)->step(s->instance, start, step, &event);
    const Verdict verdict = s->waits ? IS_MISUSED : leads_on ? MAY_BE_TAKEN : IS_REFUSED;
    const bool is_done = subject_end(s, "step", legal_in(s, STEP, verdict), status);
    s->waits = is_done ? event : s->waits;
    s->now = is_done ? start + step : s->now;
    s->steps += is_done;
    return is_done;
}

bool subject_terminate(Subject *s) {
    subject_begin(s);
    return subject_to_mode(s, "terminate", legal_in(s, INITIALIZED, SUCCEEDS), version_of(s)->terminate(s->instance),
                           TERMINATED);
}

bool subject_reset(Subject *s) {
    subject_begin(s);
    const Status status = version_of(s)->reset(s->instance);
    s->nx = s->fmu->nx;
    s->ny = s->fmu->ny;
    s->depth = s->fmu->depth;
    s->waits = false;
    return subject_to_mode(s, "reset", SUCCEEDS, status, INSTANTIATED);
}

size_t value_count(const Subject *s, const Variable *variable) {
    return variable->shape == ONE_VALUE ? 1 : (size_t)(s->nx * s->ny * (variable->shape == MAPS ? s->depth : 1));
}

/* The references of a variable, and how many there are. */
static size_t references_of(const Subject *s, const Variable *variable, uint32_t references[CELLS_MAX]) {
    const size_t count = s->fmu->has_scalar_references ? value_count(s, variable) : 1;
    for (size_t k = 0; k < count; k++)
        references[k] = variable->reference + (uint32_t)k;
    return count;
}

double subject_get(Subject *s, const Variable *variable) {
    uint32_t references[CELLS_MAX];
    double values[CELLS_MAX];
    const char kind = version_of(s)->kind(variable->type);
    const size_t count = references_of(s, variable, references);
    subject_begin(s);
    const Status status = version_of(s)->get(s->instance, kind, references, count, values, value_count(s, variable));
    subject_end(s, variable->name, SUCCEEDS, status);
    return version_of(s)->decode(kind, values);
}

bool subject_set(Subject *s, const Variable *variable, const double values[], size_t count) {
    uint32_t references[CELLS_MAX];
    double room[CELLS_MAX];
    const char kind = version_of(s)->kind(variable->type);
    const size_t size = version_of(s)->value_size(kind), total = value_count(s, variable);
    for (size_t k = 0; k < total; k++)
        version_of(s)->encode(kind, values[k % count], (unsigned char *)room + k * size);
    const size_t reference_count = references_of(s, variable, references);
    subject_begin(s);
    const Status status = version_of(s)->set(s->instance, kind, references, reference_count, room, total);
    return subject_end(s, variable->name, MAY_BE_TAKEN, status);
}

bool subject_configure(Subject *s, bool enters) {
    const bool is_legal = s->fmu->is_resizable && s->mode == (enters ? INSTANTIATED : CONFIGURATION);
    if (!version_of(s)->configure)
        return false;
    subject_begin(s);
    const Status status = version_of(s)->configure(s->instance, enters);
    if (!enters && status == OK) {
        const Variable *nx = fmu_variable(s->fmu, "nx", 0), *ny = fmu_variable(s->fmu, "ny", 0);
        const Variable *depth = fmu_variable(s->fmu, "region_intervals", 's');
        s->mode = INSTANTIATED;
        s->nx = (uint64_t)subject_get(s, nx);
        s->ny = (uint64_t)subject_get(s, ny);
        s->depth = depth ? (uint64_t)subject_get(s, depth) : 1;
        subject_begin(s);
        demand(s, "exit configuration", s->nx >= 1 && s->ny >= 1 && is_legal, "a grid has cells");
        remember(s);
        return true;
    }
    return subject_to_mode(s, "configure",
                           !is_legal ? IS_MISUSED
                           : enters  ? SUCCEEDS
                                     : MAY_BE_TAKEN,
                           status, enters ? CONFIGURATION : INSTANTIATED);
}

void subject_resize(Subject *s, double nx, double ny) {
    if (!subject_configure(s, true))
        return;
    subject_set(s, fmu_variable(s->fmu, "nx", 0), &nx, 1);
    subject_set(s, fmu_variable(s->fmu, "ny", 0), &ny, 1);
    if (subject_configure(s, false))
        return;
    const double least = 1.0;
    subject_set(s, fmu_variable(s->fmu, "nx", 0), &least, 1);
    subject_set(s, fmu_variable(s->fmu, "ny", 0), &least, 1);
    demand(s, "exit configuration", subject_configure(s, false), "one cell is possible");
}

/* Sets an input to a number; true where there is no such input. */
static bool set_input(Subject *s, const char *name, double value) {
    const Variable *variable = fmu_variable(s->fmu, name, 'i');
    return !variable || subject_set(s, variable, &value, 1);
}

static double output(Subject *s, const char *name) {
    const Variable *variable = fmu_variable(s->fmu, name, '-');
    return variable ? subject_get(s, variable) : 0.0;
}

bool subject_offer(Subject *s, unsigned seed) {
    const Variable *pattern = fmu_variable(s->fmu, "pattern", 'i');
    const Variable *surface = fmu_variable(s->fmu, "height", 'i'), *scan = fmu_variable(s->fmu, "measured_height", 'i');
    double kinds[7], heights[7];
    for (unsigned k = 0; k < 7; k++) {
        kinds[k] = (seed >> k) % 3;
        heights[k] = 1e-7 * (double)((seed * (2 * k + 3)) % 256);
    }
    if (pattern)
        return subject_set(s, pattern, kinds, 7) && set_input(s, "layer_command", output(s, "layers_printed") + 1.0);
    if (surface)
        return subject_set(s, surface, heights, 7) && set_input(s, "layers_printed", output(s, "layers_scanned") + 1.0);
    if (scan) {
        const double layer = output(s, "layer_command");
        return subject_set(s, scan, heights, 7) && set_input(s, "layers_scanned", layer) &&
               set_input(s, "layers_printed", layer);
    }
    return set_input(s, "start", 1.0);
}
