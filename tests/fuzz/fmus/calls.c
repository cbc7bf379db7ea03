/* FMI calls in any order with any arguments on one instance, while a second instance must not change. The FMU is the
 * one of the table named in INKLOOP_FMU_TABLE; an input is read as a sequence of calls. */
#include "events.h"
#include "values.h"

#include <math.h>
#include <string.h>

enum { SLOTS = 3 };

/* A state that was saved, and what is known of it. */
typedef struct {
    void *state;
    Saved bytes;
    Mode mode;
    uint64_t nx, ny, depth;
    double now;
    bool waits;
} Slot;

typedef struct {
    Subject subject;
    Slot slots[SLOTS];
} Run;

static bool is_of_size(const Slot *slot, const Subject *s) {
    return slot->nx == s->nx && slot->ny == s->ny && slot->depth == s->depth;
}

static void drop(Run *run, Slot *slot) {
    Subject *s = &run->subject;
    subject_begin(s);
    subject_end(s, "free state", SUCCEEDS, s->fmu->version->free_state(s->instance, &slot->state));
    demand(s, "free state", slot->state == NULL, "a freed state is gone");
    free(slot->bytes.bytes);
    *slot = (Slot){.mode = INSTANTIATED};
}

/* Into an empty place or over an older state, which may be of another size. */
static void take_state(Run *run, Slot *slot) {
    Subject *s = &run->subject;
    subject_begin(s);
    const Status status = s->fmu->version->get_state(s->instance, &slot->state);
    const unsigned modes = ANY_MODE & ~(unsigned)CONFIGURATION;
    if (!subject_end(s, "get state", legal_in(s, modes, SUCCEEDS), status))
        return;
    free(slot->bytes.bytes);
    *slot = (Slot){slot->state, subject_save(s), s->mode, s->nx, s->ny, s->depth, s->now, s->waits};
}

static void restore(Run *run, const Slot *slot) {
    Subject *s = &run->subject;
    const bool fits = slot->state && is_of_size(slot, s) && s->mode != CONFIGURATION;
    const Mode old = s->mode;
    subject_begin(s);
    const Status status = s->fmu->version->set_state(s->instance, slot->state);
    s->mode = status == OK && fits ? slot->mode : old;
    if (!subject_end(s, "set state", fits ? SUCCEEDS : IS_MISUSED, status))
        return;
    s->now = slot->now;
    s->waits = slot->waits;
    demand(s, "set state", is_same(&s->before, &slot->bytes), "a restored state is the saved one");
}

/* The bytes of a state as a caller may pass them: unchanged, with some altered, or cut. */
static void carry(Run *run, Slot *slot, Input *input) {
    Subject *s = &run->subject;
    const uint8_t form = input_byte(input);
    if (!slot->state)
        return;
    Saved bytes = {malloc(slot->bytes.size + 8), slot->bytes.size};
    if (!bytes.bytes)
        exit(2);
    memcpy(bytes.bytes, slot->bytes.bytes, bytes.size);
    memset(bytes.bytes + bytes.size, 0, 8);
    for (unsigned k = 0; k < form % 4u; k++) {
        const size_t place = ((size_t)input_word(input) << 8 | input_byte(input)) % bytes.size;
        bytes.bytes[place] = (uint8_t)(bytes.bytes[place] ^ (1u << input_byte(input) % 8));
    }
    if (form >= 224)
        bytes.size = form % 2 ? bytes.size - 1 - input_byte(input) % bytes.size : bytes.size + 8;
    const bool is_whole = is_same(&bytes, &slot->bytes);
    const bool fits = is_of_size(slot, s);
    subject_begin(s);
    void *made = NULL;
    const Status status = s->fmu->version->deserialize(s->instance, bytes.bytes, bytes.size, &made);
    if (subject_end(s, "deserialize", is_whole && fits ? SUCCEEDS : IS_MISUSED, status)) {
        s->fmu->version->free_state(s->instance, &slot->state);
        slot->state = made;
    }
    free(bytes.bytes);
}

/* Room for a state that is a byte too small. */
static void serialize_short(Run *run, const Slot *slot) {
    Subject *s = &run->subject;
    if (!slot->state)
        return;
    unsigned char *room = malloc(slot->bytes.size);
    if (!room)
        exit(2);
    subject_begin(s);
    const Status status = s->fmu->version->serialize(s->instance, slot->state, room, slot->bytes.size - 1);
    subject_end(s, "serialize", IS_MISUSED, status);
    free(room);
}

static void log_categories(Subject *s, Input *input) {
    static const char *const NAMES[] = {"logStatusDiscard", "logStatusError", "logAll", "", "%s%n"};
    const char *given[3] = {NAMES[0], NAMES[1], NULL};
    const size_t count = input_byte(input) % 4u;
    const uint8_t which = input_byte(input) % 5u;
    given[2] = NAMES[which];
    subject_begin(s);
    const Status status = s->fmu->version->set_categories(s->instance, count, given);
    subject_end(s, "set debug logging", count < 3 || which < 2 ? SUCCEEDS : IS_MISUSED, status);
}

static void any_size(Subject *s, Input *input) {
    static const double SIZES[] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 134217728.0, 4294967296.0, 1.8446744073709552e19};
    const uint8_t which = input_byte(input);
    subject_resize(s, SIZES[which % 10], SIZES[which / 10 % 10]);
}

/* With little work to come: thousands of short lives find more than a few long ones. */
static void enter(Subject *s, double start) {
    if (s->mode == INSTANTIATED)
        spare_work(s);
    subject_enter(s, start);
}

/* The next call of a life as it should be. */
static void go_on(Subject *s, Input *input) {
    switch (s->mode) {
    case INSTANTIATED:
        enter(s, (double)(input_byte(input) % 4));
        break;
    case CONFIGURATION:
        subject_configure(s, false);
        break;
    case INITIALIZATION:
        subject_exit(s);
        break;
    case EVENT:
        events_handle(s, input, false);
        break;
    case STEP:
        if (s->waits)
            events_handle(s, input, true);
        if (subject_offer(s, input_byte(input)) && subject_step(s, s->now, s->fmu->has_events ? 0.05 : 10.0))
            s->layers++;
        break;
    case TERMINATED:
        subject_reset(s);
    }
}

static void any_step(Subject *s, Input *input) {
    const uint8_t form = input_byte(input);
    const double start = form % 4 == 0 ? any_number(input) : s->now, size = any_number(input);
    subject_step(s, form % 16 == 15 ? s->now - 1.0 : start, size);
}

static void any_call(Run *run, Input *input) {
    Subject *s = &run->subject;
    const uint8_t which = input_byte(input);
    Slot *slot = &run->slots[input_byte(input) % SLOTS];
    switch (which % 32) {
    case 0:
        enter(s, any_number(input));
        break;
    case 1:
        subject_exit(s);
        break;
    case 2:
        if (which < 64)
            subject_terminate(s);
        break;
    case 3:
        if (which < 64)
            subject_reset(s);
        break;
    case 4:
        any_size(s, input);
        break;
    case 5:
        subject_configure(s, which % 2);
        break;
    case 6:
        take_state(run, slot);
        break;
    case 7:
        restore(run, slot);
        break;
    case 8:
        carry(run, slot, input);
        break;
    case 9:
        drop(run, slot);
        break;
    case 10:
        serialize_short(run, slot);
        break;
    case 11:
        log_categories(s, input);
        break;
    case 12:
        any_event_call(s, input);
        break;
    case 13:
    case 14:
        any_access(s, input, false);
        break;
    case 15:
    case 16:
    case 17:
        any_step(s, input);
        break;
    default:
        if (which % 32 < 25)
            any_access(s, input, true);
        else
            go_on(s, input);
    }
}

/* Another instance takes the state over, and one that is reset is new. */
static void end(Run *run, const Saved *new_one) {
    Subject *s = &run->subject;
    take_state(run, &run->slots[0]);
    if (s->mode != CONFIGURATION && s->nx == s->fmu->nx && s->ny == s->fmu->ny && s->depth == s->fmu->depth) {
        Subject heir;
        subject_open(&heir, s->fmu);
        demand(&heir, "open", is_same(&heir.before, new_one), "new instances are alike");
        Run other = {.subject = heir};
        restore(&other, &run->slots[0]);
        subject_close(&other.subject);
    }
    subject_reset(s);
    demand(s, "reset", is_same(&s->before, new_one), "a reset instance is new");
    for (int k = 0; k < SLOTS; k++)
        drop(run, &run->slots[k]);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t length) {
    static Fmu fmu;
    if (!fmu.version)
        fmu_open(&fmu, getenv("INKLOOP_FMU_TABLE"));
    Run run;
    Subject bystander;
    memset(&run, 0, sizeof run);
    subject_open(&run.subject, &fmu);
    subject_open(&bystander, &fmu);
    Input input = {bytes, length};
    while (input.left > 0)
        any_call(&run, &input);
    end(&run, &bystander.before);
    Saved untouched = subject_save(&bystander);
    demand(&bystander, "save", is_same(&untouched, &bystander.before), "no call reaches another instance");
    free(untouched.bytes);
    if (getenv("INKLOOP_FUZZ_SHOWS"))
        fprintf(stderr, "steps %u layers %u refusals %u\n", run.subject.steps, run.subject.layers,
                run.subject.refusals);
    subject_close(&run.subject);
    subject_close(&bystander);
    return 0;
}
