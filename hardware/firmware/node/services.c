#include "services.h"

#include <string.h>

#include "bytes.h"
#include "height_map.h"
#include "routines.h"
#include "transfer.h"
#include "uds.h"

#ifndef INKLOOP_VERSION
#define INKLOOP_VERSION "unversioned"
#endif

enum { SESSION_TIMEOUT_MS = 5000 /* S3 of ISO 14229-2 */ };
enum { ANSWER_TIME_MS = 1000, PENDING_TIME_10MS = 500, READ_HEAD = 3, JOURNAL_RECORDS_MAX = 100 };

static uint8_t subfunction(const uint8_t *request) {
    return request[1] & (uint8_t)~UDS_SUPPRESS;
}

static size_t put_numbers(uint8_t *to, const uint32_t *numbers, size_t count) {
    for (size_t k = 0; k < count; k++)
        put_u32(to + 4 * k, numbers[k]);
    return 4 * count;
}

static uint8_t flags_of(const Node *node) {
    return (uint8_t)((node->needs_operator ? 1 : 0) | (node->stop_active ? 2 : 0) | (node->pattern_loaded ? 4 : 0) |
                     (node->dry ? 8 : 0) | (node->scanned ? 16 : 0) | (node->journal.damaged ? 32 : 0) |
                     (node->options.by_watchdog ? 64 : 0) | (node->journal.unread ? 128 : 0));
}

static size_t put_state(const Node *node, uint8_t *to) {
    const LayerProgress *progress = &node->progress;
    const uint8_t first[4] = {(uint8_t)node->state, (uint8_t)node->cause, node->options.roles, flags_of(node)};
    const uint8_t layer[6] = {progress->passes, progress->done,  progress->unknown,
                              progress->cured,  progress->flags, (uint8_t)node->step.kind};
    memcpy(to, first, sizeof first);
    put_u32(to + 4, progress->job);
    put_u16(to + 8, progress->layer);
    memcpy(to + 10, layer, sizeof layer);
    put_u16(to + 16, progress->boots);
    put_u16(to + 18, node->master.session);
    const uint32_t rest[] = {progress->pattern_crc, node->now, node->gate_pulses};
    return 20 + put_numbers(to + 20, rest, 3);
}

static size_t put_times(const Node *node, uint8_t *to) {
    const NodeTimes *times = &node->times;
    const uint32_t numbers[] = {node->now,       times->master_alive, times->safe,       times->lamp_on,
                                times->lamp_off, times->gate_opened,  times->gate_closed};
    return put_numbers(to, numbers, sizeof numbers / sizeof *numbers);
}

static size_t put_limits(const Node *node, uint8_t *to) {
    const NodeLimits *limits = &node->options.limits;
    const uint32_t numbers[] = {node->options.pattern_bytes,
                                limits->alive,
                                limits->lamp,
                                limits->gate,
                                limits->pass,
                                limits->motion,
                                limits->scan};
    const size_t length = put_numbers(to, numbers, sizeof numbers / sizeof *numbers);
    put_u16(to + length, BLOCK_MAX);
    return length + 2;
}

static size_t put_map(const Node *node, uint8_t *to) {
    const MapShape shape = node->hal->map_shape(node->hal->context);
    put_u32(to, node->scanned ? height_map_bytes(node->hal) : 0);
    put_u16(to + 4, shape.nx);
    put_u16(to + 6, shape.ny);
    return 8;
}

static size_t put_transfer(const Node *node, uint8_t *to) {
    const Transfer *transfer = &node->transfer;
    to[0] = (uint8_t)((transfer->active ? 1 : 0) | (transfer->upload ? 2 : 0));
    to[1] = transfer->next_counter;
    put_u16(to + 2, transfer->layer);
    const uint32_t numbers[] = {transfer->job, transfer->done, transfer->size};
    return 4 + put_numbers(to + 4, numbers, sizeof numbers / sizeof *numbers);
}

static size_t put_journal(const Node *node, uint8_t *to, size_t room) {
    const size_t records = room / RECORD_BYTES;
    const uint32_t most = records < JOURNAL_RECORDS_MAX ? (uint32_t)records : JOURNAL_RECORDS_MAX;
    return journal_read(&node->journal, to, most) * RECORD_BYTES;
}

static size_t read_identifier(const Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room) {
    if (length != READ_HEAD)
        return uds_refusal(answer, UDS_READ, UDS_LENGTH);
    uint8_t *to = answer + READ_HEAD;
    size_t size = 0;
    switch (get_u16(request + 1)) {
    case ID_SESSION:
        to[0] = node->session;
        size = 1;
        break;
    case ID_VERSION:
        size = sizeof INKLOOP_VERSION - 1;
        memcpy(to, INKLOOP_VERSION, size);
        break;
    case ID_STATE:
        size = put_state(node, to);
        break;
    case ID_TIMES:
        size = put_times(node, to);
        break;
    case ID_LIMITS:
        size = put_limits(node, to);
        break;
    case ID_MAP:
        if (!node_has(node, ROLE_PROFILER))
            return uds_refusal(answer, UDS_READ, UDS_OUT_OF_RANGE);
        size = put_map(node, to);
        break;
    case ID_TRANSFER:
        size = put_transfer(node, to);
        break;
    case ID_JOURNAL:
        size = put_journal(node, to, room - READ_HEAD);
        break;
    default:
        return uds_refusal(answer, UDS_READ, UDS_OUT_OF_RANGE);
    }
    answer[0] = UDS_READ + UDS_POSITIVE;
    memcpy(answer + 1, request + 1, 2);
    return READ_HEAD + size;
}

static size_t session(Node *node, const uint8_t *request, size_t length, uint8_t *answer) {
    if (length != 2)
        return uds_refusal(answer, UDS_SESSION, UDS_LENGTH);
    node->session = subfunction(request);
    answer[0] = UDS_SESSION + UDS_POSITIVE;
    answer[1] = node->session;
    put_u16(answer + 2, ANSWER_TIME_MS);
    put_u16(answer + 4, PENDING_TIME_10MS);
    return 6;
}

static size_t tester_present(const uint8_t *request, size_t length, uint8_t *answer) {
    if (length != 2)
        return uds_refusal(answer, UDS_TESTER_PRESENT, UDS_LENGTH);
    answer[0] = UDS_TESTER_PRESENT + UDS_POSITIVE;
    answer[1] = subfunction(request);
    return 2;
}

static size_t transfer(Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room, Cause *cause) {
    if (node->step.kind != STEP_NONE)
        return uds_refusal(answer, request[0], UDS_BUSY);
    switch (request[0]) {
    case UDS_DOWNLOAD:
        return transfer_download(node, request, length, answer);
    case UDS_UPLOAD:
        return transfer_upload(node, request, length, answer);
    case UDS_TRANSFER:
        return transfer_block(node, request, length, answer, room);
    default:
        return transfer_exit(node, request, length, answer, cause);
    }
}

/* Requirements of a service before its own checks. */
typedef struct {
    uint8_t service, roles; /* roles of which one is needed */
    uint8_t shortest;       /* shortest request in bytes */
    bool has_subfunction;
    uint8_t subfunctions[2];
} Service;

static const Service SERVICES[] = {
    {UDS_SESSION, 0xFF, 2, true, {SESSION_DEFAULT, SESSION_EXTENDED}},
    {UDS_READ, 0xFF, READ_HEAD, false, {0}},
    {UDS_ROUTINE_CONTROL, 0xFF, 2, true, {UDS_START, UDS_RESULTS}},
    {UDS_DOWNLOAD, ROLE_HEAD, 1, false, {0}},
    {UDS_UPLOAD, ROLE_PROFILER, 1, false, {0}},
    {UDS_TRANSFER, ROLE_HEAD | ROLE_PROFILER, 2, false, {0}},
    {UDS_TRANSFER_EXIT, ROLE_HEAD | ROLE_PROFILER, 1, false, {0}},
    {UDS_TESTER_PRESENT, 0xFF, 2, true, {0, 0}},
};

/* NULL: this node does not have the service. */
static const Service *find_service(const Node *node, uint8_t number) {
    for (size_t k = 0; k < sizeof SERVICES / sizeof *SERVICES; k++)
        if (SERVICES[k].service == number && node_has(node, SERVICES[k].roles))
            return &SERVICES[k];
    return NULL;
}

/* The checks that come before those of a service, in the order of ISO 14229-1: the service, the shortest request, the
 * sub-function. UDS_OK, or the code that refuses the request. */
static uint8_t check_request(const Service *service, const uint8_t *request, size_t length) {
    if (!service)
        return UDS_SERVICE_NOT_SUPPORTED;
    if (length < service->shortest)
        return UDS_LENGTH;
    const uint8_t asked = service->has_subfunction ? subfunction(request) : 0;
    const bool known = asked == service->subfunctions[0] || asked == service->subfunctions[1];
    return service->has_subfunction && !known ? UDS_SUBFUNCTION_NOT_SUPPORTED : UDS_OK;
}

static size_t serve(Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room, Cause *cause) {
    switch (request[0]) {
    case UDS_SESSION:
        return session(node, request, length, answer);
    case UDS_TESTER_PRESENT:
        return tester_present(request, length, answer);
    case UDS_READ:
        return read_identifier(node, request, length, answer, room);
    case UDS_ROUTINE_CONTROL:
        return routine_control(node, request, length, answer, cause);
    default:
        return transfer(node, request, length, answer, room, cause);
    }
}

size_t services_answer(Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room, Cause *cause) {
    if (length == 0 || room < ANSWER_ROOM)
        return 0;
    node->session_since = node->now;
    const Service *service = find_service(node, request[0]);
    const uint8_t code = check_request(service, request, length);
    if (code != UDS_OK)
        return uds_refusal(answer, request[0], code);
    const size_t answered = serve(node, request, length, answer, room, cause);
    const bool suppressed = service->has_subfunction && (request[1] & UDS_SUPPRESS) && answer[0] != UDS_NEGATIVE;
    return suppressed ? 0 : answered;
}

void services_tick(Node *node) {
    if (node->step.kind != STEP_NONE) /* its final answer is still to come */
        node->session_since = node->now;
    else if (node->session != SESSION_DEFAULT && node->now - node->session_since >= SESSION_TIMEOUT_MS)
        node->session = SESSION_DEFAULT;
}
