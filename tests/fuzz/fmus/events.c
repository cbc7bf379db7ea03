#include "events.h"

#include <string.h>

enum { BINARY_MAX = 96, TRANSMIT = 0x10, HEAD = 16, INSTANTS_MAX = 8 };

static const EventCalls *calls_of(const Subject *s) {
    return s->fmu->version->events;
}

static bool enter(Subject *s) {
    subject_begin(s);
    const Status status = calls_of(s)->enter(s->instance);
    const Verdict verdict = s->fmu->has_events ? legal_in(s, STEP, SUCCEEDS) : IS_MISUSED;
    return subject_to_mode(s, "enter event mode", verdict, status, EVENT);
}

static bool leave(Subject *s) {
    subject_begin(s);
    const Status status = calls_of(s)->leave(s->instance);
    const Verdict verdict = s->waits ? IS_MISUSED : legal_in(s, EVENT, SUCCEEDS);
    return subject_to_mode(s, "enter step mode", verdict, status, STEP);
}

static bool update(Subject *s) {
    bool again = false;
    subject_begin(s);
    const Status status = calls_of(s)->update(s->instance, &again);
    const bool is_done = subject_end(s, "update", legal_in(s, EVENT, SUCCEEDS), status);
    s->waits = is_done ? again : s->waits;
    return is_done;
}

static void set_clock(Subject *s, const Variable *v, bool ticks) {
    const bool is_input = v->type == 'k' && v->role == 'i';
    subject_begin(s);
    const Status status = calls_of(s)->set_clock(s->instance, v->reference, ticks);
    if (subject_end(s, "set clock", is_input ? legal_in(s, EVENT, MAY_BE_TAKEN) : IS_MISUSED, status))
        s->waits = s->waits || ticks;
}

static void get_clock(Subject *s, const Variable *v) {
    bool ticks = false;
    subject_begin(s);
    const Status status = calls_of(s)->get_clock(s->instance, v->reference, &ticks);
    if (subject_end(s, "get clock", v->type == 'k' ? SUCCEEDS : IS_MISUSED, status))
        demand(s, "get clock", !ticks || s->waits, "a clock that ticks was announced");
}

static void get_binary(Subject *s, const Variable *v) {
    size_t size = 0;
    const uint8_t *bytes = NULL;
    subject_begin(s);
    const Status status = calls_of(s)->get_binary(s->instance, v->reference, &size, &bytes);
    if (!subject_end(s, "get binary", v->type == 'y' ? SUCCEEDS : IS_MISUSED, status))
        return;
    unsigned sum = 0;
    for (size_t k = 0; k < size; k++) /* a sanitizer sees bytes that are not there */
        sum += bytes[k];
    demand(s, "get binary", (double)size <= v->max && (size > 0 || sum == 0), "it has its bytes");
}

/* Operations of a bus: a frame for the nodes, some bytes altered, or any bytes. */
static size_t operations(Input *input, uint8_t bytes[BINARY_MAX]) {
    static const uint16_t IDS[] = {0x010, 0x080, 0x640, 0x642, 0x644, 0x646, 0x7FF};
    size_t size = 0;
    for (unsigned frames = input_byte(input) % 4u; size + HEAD + 8 <= BINARY_MAX && frames > 0; frames--) {
        const uint8_t form = input_byte(input);
        const uint16_t id = IDS[form % 7];
        const uint8_t head[HEAD] = {TRANSMIT,           0, 0, 0, HEAD + 8, 0, 0, 0, (uint8_t)id,
                                    (uint8_t)(id >> 8), 0, 0, 0, 0,        8};
        memcpy(bytes + size, head, HEAD);
        for (int k = 0; k < 8; k++)
            bytes[size + HEAD + (size_t)k] = input_byte(input);
        if (form >= 200)
            bytes[size + form % 16] = input_byte(input);
        size += HEAD + 8;
    }
    return size > 0 ? size - (input_byte(input) >= 250) : 0;
}

static void set_binary(Subject *s, const Variable *v, Input *input) {
    uint8_t room[BINARY_MAX];
    const size_t size = operations(input, room);
    uint8_t *exact = malloc(size ? size : 1);
    if (!exact)
        exit(2);
    memcpy(exact, room, size);
    subject_begin(s);
    const Status status = calls_of(s)->set_binary(s->instance, v->reference, size, exact);
    const bool is_input = v->type == 'y' && v->role == 'i';
    const bool is_lost = size > 0 && !s->waits;
    subject_end(s, "set binary", is_input && !is_lost ? legal_in(s, RUNNING, MAY_BE_TAKEN) : IS_MISUSED, status);
    free(exact);
}

static void set_string(Subject *s, const Variable *v, Input *input) {
    static const char *const TEXTS[] = {"",
                                        "loss:probability=0.5",
                                        "burst:id=0x640;duplication; short-map:node=profiler",
                                        "reboot:node=head;hang:node=cure;death:node=stage",
                                        "unplugged",
                                        ";;x;",
                                        "broken",
                                        "%s%n"};
    subject_begin(s);
    const Status status = calls_of(s)->set_string(s->instance, v->reference, TEXTS[input_byte(input) % 8]);
    const bool is_parameter = v->type == 's' && v->role == 'p';
    subject_end(s, "set string", is_parameter ? legal_in(s, BEFORE_STEP, MAY_BE_TAKEN) : IS_MISUSED, status);
}

bool events_handle(Subject *s, Input *input, bool sends) {
    const Variable *clock = fmu_variable(s->fmu, "Rx_Clock", 'i'), *data = fmu_variable(s->fmu, "Rx_Data", 'i');
    if (!s->fmu->has_events || (s->mode == STEP && !enter(s)))
        return !s->fmu->has_events;
    if (sends && clock && data) {
        set_clock(s, clock, true);
        set_binary(s, data, input);
    }
    for (int k = 0; k < INSTANTS_MAX && (k == 0 || s->waits); k++)
        update(s);
    return leave(s);
}

void any_event_call(Subject *s, Input *input) {
    const Variable *any = &s->fmu->variables[input_byte(input) % s->fmu->variable_count];
    const Variable *data = fmu_variable(s->fmu, "Rx_Data", 'i'), *clock = fmu_variable(s->fmu, "Rx_Clock", 'i');
    const Variable *faults = fmu_variable(s->fmu, "faults", 'p');
    const uint8_t which = input_byte(input);
    if (!calls_of(s))
        return;
    switch (which % 8) {
    case 0:
        enter(s);
        break;
    case 1:
        leave(s);
        break;
    case 2:
        update(s);
        break;
    case 3:
        set_clock(s, clock && which < 200 ? clock : any, which % 16 < 8);
        break;
    case 4:
        set_binary(s, data && which < 200 ? data : any, input);
        break;
    case 5:
        set_string(s, faults && which < 200 ? faults : any, input);
        break;
    case 6:
        get_clock(s, any);
        break;
    default:
        get_binary(s, any);
    }
}
