#include "values.h"

#include <math.h>
#include <string.h>

enum { REFERENCES_MAX = 4, VALUES_MAX = 256 };

typedef struct {
    char kind;
    uint32_t references[REFERENCES_MAX];
    size_t count, total;
    unsigned char *values; /* `total` bytes, so that a sanitizer sees an access beyond */
    Verdict verdict;
    const Variable *only; /* where there is one reference */
} Access;

double any_number(Input *input) {
    static const double NUMBERS[] = {0.0,  -0.0,         1.0,          -1.0,          2.0,          5e-324,   1e-300,
                                     1e-9, 1e-6,         0.1,          3.0,           1000.0,       1e9,      1e15,
                                     -1e9, 1e100,        1e307,        1e308,         -1e308,       INFINITY, -INFINITY,
                                     NAN,  2147483647.0, 2147483648.0, -2147483648.0, 4294967296.0, 1.8e19};
    const uint8_t byte = input_byte(input);
    if (byte < sizeof NUMBERS / sizeof *NUMBERS)
        return NUMBERS[byte];
    return (double)(byte - 64) / 16.0;
}

/* For a variable: within its limits, at them, beyond them, or any number. */
static double any_number_for(const Variable *v, Input *input) {
    const uint8_t byte = input_byte(input);
    const double step = v->type == 'r' ? 1e-3 * fabs(v->start) + 1e-9 : 1.0;
    switch (byte % 16) {
    case 0:
        return v->min;
    case 1:
        return v->max;
    case 2:
        return v->min - step;
    case 3:
        return v->max + step;
    case 4:
    case 5:
        return any_number(input);
    case 6:
        return v->start * 1e6;
    case 7:
    case 8:
        return isfinite(v->min) ? v->min + step * (byte >> 4) : v->start;
    default:
        return v->start * (double)(byte >> 4) / 4.0 + (v->type == 'r' ? 0.0 : byte >> 6);
    }
}

static bool is_too_much(const Variable *v, double number) {
    return isfinite(v->most_tried) && number >= v->min && number <= v->max && (number > v->most_tried || number < 0.0);
}

static double number_for(const Variable *v, Input *input) {
    const double number = any_number_for(v, input);
    return is_too_much(v, number) ? v->most_tried : number;
}

void spare_work(Subject *s) {
    for (size_t k = 0; k < s->fmu->variable_count; k++) {
        const Variable *v = &s->fmu->variables[k];
        if (v->role == 'p' && is_too_much(v, v->start) && subject_get(s, v) == v->start)
            subject_set(s, v, &v->most_tried, 1);
    }
}

static bool is_within(const Variable *v, double number) {
    return isfinite(number) && number >= v->min && number <= v->max;
}

static Verdict worse(Verdict one, Verdict other) {
    return one > other ? one : other;
}

/* Verdict of the standard on setting a variable now. */
static Verdict settable(const Subject *s, const Variable *v) {
    switch (v->role) {
    case 'i':
    case 't':
        return legal_in(s, RUNNING, MAY_BE_TAKEN);
    case 'p':
        return legal_in(s, BEFORE_STEP, MAY_BE_TAKEN);
    case 's':
        return legal_in(s, CONFIGURATION, MAY_BE_TAKEN);
    default:
        return IS_MISUSED;
    }
}

/* Adds a variable, or one cell of it, with `numbers` for it. */
static void add(const Subject *s, Access *access, const Variable *v, bool sets, Input *input) {
    const Version *version = s->fmu->version;
    const size_t cells = value_count(s, v), taken = s->fmu->has_scalar_references ? 1 : cells;
    const size_t size = version->value_size(access->kind);
    if (access->total + taken > VALUES_MAX)
        return;
    const uint8_t cell = input_byte(input);
    access->references[access->count++] = v->reference + (s->fmu->has_scalar_references ? cell % (uint32_t)cells : 0);
    access->only = access->count == 1 ? v : NULL;
    if (version->kind(v->type) != access->kind)
        access->verdict = IS_MISUSED;
    else
        access->verdict = worse(access->verdict, sets ? settable(s, v) : SUCCEEDS);
    const double usual = number_for(v, input), other = number_for(v, input);
    for (size_t k = 0; k < taken; k++, access->total++) {
        unsigned char *place = access->values + access->total * size;
        const double number = version->encode(access->kind, k == cell % taken ? other : usual, place);
        if (sets && !is_within(v, number))
            access->verdict = worse(access->verdict, IS_REFUSED);
    }
}

/* Sometimes a reference that there is not, or a number of values that does not fit. */
static void distort(const Subject *s, Access *access, Input *input) {
    const uint8_t byte = input_byte(input);
    if (byte < 8 && access->count > 0) {
        access->references[byte % access->count] = UINT32_MAX - byte;
        access->verdict = IS_MISUSED;
    }
    if (byte >= 240 && !s->fmu->has_scalar_references) {
        access->total = byte < 248 ? access->total + 1 + byte % 4 : access->total / 2;
        access->verdict = byte < 248 || access->total > 0 || access->count > 0 ? IS_MISUSED : access->verdict;
    }
}

static void finish(Subject *s, Access *access, bool sets) {
    const Version *version = s->fmu->version;
    const size_t bytes = access->total * version->value_size(access->kind);
    unsigned char *exact = malloc(bytes ? bytes : 1), *read = malloc(bytes ? bytes : 1);
    if (!exact || !read)
        exit(2);
    memcpy(exact, access->values, bytes);
    memset(read, 0, bytes);
    subject_begin(s);
    const Status status =
        sets ? version->set(s->instance, access->kind, access->references, access->count, exact, access->total)
             : version->get(s->instance, access->kind, access->references, access->count, read, access->total);
    const bool is_done = subject_end(s, sets ? "set" : "get", access->verdict, status);
    for (size_t k = 0; is_done && !sets && access->kind == 'r' && k < access->total; k++)
        demand(s, "get", isfinite(version->decode('r', (double *)(void *)read + k)), "what is read is finite");
    if (is_done && sets && access->only && access->only->role != 's') {
        subject_begin(s);
        const Status again =
            version->get(s->instance, access->kind, access->references, access->count, read, access->total);
        subject_end(s, "get", SUCCEEDS, again);
        demand(s, "get", access->kind == 'b' || memcmp(exact, read, bytes) == 0, "what was set is read");
    }
    free(exact);
    free(read);
}

void any_access(Subject *s, Input *input, bool sets) {
    static const char TYPES[] = "ribec";
    double room[VALUES_MAX + 4]; /* aligned for every type */
    memset(room, 0, sizeof room);
    Access access = {.verdict = sets ? MAY_BE_TAKEN : SUCCEEDS, .values = (unsigned char *)room};
    const uint8_t form = input_byte(input);
    const size_t wanted = form >> 6;
    size_t which = input_byte(input) % s->fmu->variable_count;
    while (!strchr(TYPES, s->fmu->variables[which].type)) /* the others are of events.c */
        which = (which + 1) % s->fmu->variable_count;
    const Variable *first = &s->fmu->variables[which];
    access.kind = s->fmu->version->kind(form % 16 == 0 ? TYPES[form / 16 % 5] : first->type);
    for (size_t k = 0; k < wanted || k == 0; k++) {
        const Variable *next = &s->fmu->variables[input_byte(input) % s->fmu->variable_count];
        const bool fits = s->fmu->version->kind(next->type) == access.kind || form % 8 == 1;
        add(s, &access, k > 0 && fits ? next : first, sets, input);
    }
    distort(s, &access, input);
    finish(s, &access, sets);
}
