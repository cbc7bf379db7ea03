#include "fault_text.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WORD = 64, DIGITS_BASE = 0 /* decimal, or hexadecimal with 0x */ };

typedef struct {
    const char *name;
    uint32_t count, frames; /* defaults; 0 in `count`: one */
    bool needs_node;
} KindOf;

static const KindOf KINDS[FAULT_KINDS] = {[FAULT_LOSS] = {.name = "loss"},
                                          [FAULT_BURST] = {.name = "burst", .count = 16},
                                          [FAULT_CORRUPTION] = {.name = "corruption"},
                                          [FAULT_DUPLICATION] = {.name = "duplication"},
                                          [FAULT_SWAP] = {.name = "swap", .frames = 1},
                                          [FAULT_DELAY] = {.name = "delay", .frames = 10},
                                          [FAULT_FLOW_CONTROL] = {.name = "flow-control"},
                                          [FAULT_MALFORMED_LINE] = {.name = "malformed-line"},
                                          [FAULT_TRANSMIT_ORDER] = {.name = "transmit-order", .frames = 1},
                                          [FAULT_SHORT_QUEUE] = {"short-queue", UINT32_MAX, 3, false},
                                          [FAULT_STUCK_COUNTER] = {.name = "stuck-counter", .count = 10},
                                          [FAULT_BAD_CHECK] = {.name = "bad-check", .count = 10},
                                          [FAULT_LATE_ANSWER] = {.name = "late-answer"},
                                          [FAULT_REPEATED_ANSWER] = {.name = "repeated-answer"},
                                          [FAULT_SHORT_MAP] = {.name = "short-map"},
                                          [FAULT_REBOOT] = {.name = "reboot", .needs_node = true},
                                          [FAULT_DEATH] = {.name = "death", .needs_node = true},
                                          [FAULT_HANG] = {.name = "hang", .needs_node = true},
                                          [FAULT_SLOW_ERASE] = {"slow-erase", 1, 2, true},
                                          [FAULT_UNREADABLE] = {"unreadable", 2, 0, true},
                                          [FAULT_BROKEN] = {.name = "broken"},
                                          [FAULT_SECOND_MASTER] = {.name = "second-master", .count = 10},
                                          [FAULT_UNPLUGGED] = {.name = "unplugged"},
                                          [FAULT_BUS_OFF] = {.name = "bus-off", .frames = 10}};
static const char *const WAY_NAMES[] = {"to-nodes", "from-nodes", NULL};
static const char *const NODE_NAMES[] = {"head", "stage", "cure", "profiler", NULL};
static const char *const STEP_NAMES[] = {"none", "home",      "move",     "purge",  "pass", "cure",
                                         "scan", "self-test", "download", "upload", NULL};

static const char *const PART_NAMES[] = {
    "gate-stays-open", "gate-stays-closed", "lamp-stays-on",  "not-ready",    "work-fails",
    "work-hangs",      "storage-full",      "lamp-stays-off", "end-switches", NULL};

typedef struct {
    const char *name;
    const char *const *choices; /* names of the values; NULL: a number */
    size_t at;
    double least, most;
} KeyOf;

#define MEMBER(name) offsetof(Fault, name)
static const KeyOf COUNTS[] = {{"nth", NULL, MEMBER(nth), 1, UINT32_MAX},
                               {"count", NULL, MEMBER(count), 1, UINT32_MAX},
                               {"frames", NULL, MEMBER(frames), 1, UINT32_MAX}};
static const KeyOf CHOICES[] = {{"way", WAY_NAMES, MEMBER(way), 0, 0},
                                {"node", NODE_NAMES, MEMBER(node), 0, 0},
                                {"part", PART_NAMES, MEMBER(part), 0, 0},
                                {"step", STEP_NAMES, MEMBER(step), 0, 0},
                                {"id", NULL, MEMBER(id), 0, CAN_ID_MAX},
                                {"service", NULL, MEMBER(service), 0, 0xBF},
                                {"byte", NULL, MEMBER(byte), 0, CAN_DATA_MAX - 1},
                                {"layer", NULL, MEMBER(layer), 0, UINT16_MAX},
                                {"pass", NULL, MEMBER(pass), 0, PASSES_MAX - 1},
                                {"seed", NULL, MEMBER(seed), 0, INT32_MAX}};

static bool read_number(const char *text, double least, double most, double *number) {
    char *rest;
    const long long whole = strtoll(text, &rest, DIGITS_BASE);
    *number = (double)whole;
    return rest != text && *rest == '\0' && *number >= least && *number <= most;
}

static bool read_choice(const KeyOf *key, const char *text, int32_t *to) {
    double number;
    for (int k = 0; key->choices && key->choices[k]; k++)
        if (strcmp(key->choices[k], text) == 0) {
            *to = k;
            return true;
        }
    if (key->choices || !read_number(text, key->least, key->most, &number))
        return false;
    *to = (int32_t)number;
    return true;
}

static bool read_probability(Fault *fault, const char *text) {
    char *rest;
    fault->probability = strtod(text, &rest);
    return rest != text && *rest == '\0' && fault->probability > 0.0 && fault->probability <= 1.0;
}

/* -1: unknown key; 0: invalid value; 1: read. */
static int read_pair(Fault *fault, const char *name, const char *value) {
    if (strcmp(name, "probability") == 0)
        return read_probability(fault, value);
    for (size_t k = 0; k < sizeof COUNTS / sizeof *COUNTS; k++) {
        double number;
        if (strcmp(COUNTS[k].name, name) != 0)
            continue;
        if (!read_number(value, COUNTS[k].least, COUNTS[k].most, &number))
            return 0;
        *(uint32_t *)(void *)((char *)fault + COUNTS[k].at) = (uint32_t)number;
        return 1;
    }
    for (size_t k = 0; k < sizeof CHOICES / sizeof *CHOICES; k++)
        if (strcmp(CHOICES[k].name, name) == 0)
            return read_choice(&CHOICES[k], value, (int32_t *)(void *)((char *)fault + CHOICES[k].at));
    return -1;
}

static bool read_kind(Fault *fault, const char *word) {
    for (int kind = 0; kind < FAULT_KINDS; kind++) {
        const KindOf *found = &KINDS[kind];
        if (strcmp(found->name, word) != 0)
            continue;
        *fault = (Fault){.kind = (FaultKind)kind,
                         .count = found->count ? found->count : 1,
                         .frames = found->frames,
                         .way = ANY,
                         .id = ANY,
                         .node = ANY,
                         .service = ANY,
                         .byte = ANY,
                         .part = ANY,
                         .layer = ANY,
                         .pass = ANY,
                         .step = ANY};
        return true;
    }
    return false;
}

/* The next word up to one of `ends`, which is skipped; false if it is too long. */
static bool next_word(const char **text, const char *ends, char word[WORD]) {
    const size_t length = strcspn(*text, ends);
    if (length >= WORD)
        return false;
    memcpy(word, *text, length);
    word[length] = '\0';
    *text += length + ((*text)[length] != '\0');
    return true;
}

bool fault_read(Fault *fault, const char *text, char *why, size_t room) {
    char name[WORD] = "", value[WORD] = ""; /* empty if a word is too long */
    if (!next_word(&text, ":", name) || !read_kind(fault, name)) {
        snprintf(why, room, "no fault is called %s", name);
        return false;
    }
    while (*text) {
        const bool whole = next_word(&text, "=", name) && next_word(&text, ",", value);
        const int read = whole ? read_pair(fault, name, value) : -1;
        if (read == 1)
            continue;
        snprintf(why, room, "%s=%s of %s: %s", name, whole ? value : "", KINDS[fault->kind].name,
                 read < 0 ? "there is no such key" : "the key does not take this value");
        return false;
    }
    if (fault->probability > 0.0 && fault->nth > 0) {
        snprintf(why, room, "give probability or nth, not both");
        return false;
    }
    if (KINDS[fault->kind].needs_node && fault->node == ANY) {
        snprintf(why, room, "it needs node=head, stage, cure or profiler");
        return false;
    }
    if (fault->kind == FAULT_BROKEN && fault->part == ANY) {
        snprintf(why, room, "it needs part=gate-stays-open, end-switches, lamp-stays-on ...");
        return false;
    }
    return true;
}

bool faults_add(Faults *faults, const char *text, char *why, size_t room) {
    if (faults->count == FAULTS_MAX) {
        snprintf(why, room, "more than %d faults", FAULTS_MAX);
        return false;
    }
    Fault *fault = &faults->fault[faults->count];
    if (!fault_read(fault, text, why, room))
        return false;
    fault->number = faults->count++;
    fault->armed = fault->step == ANY && fault->layer == ANY && fault->pass == ANY;
    return true;
}
