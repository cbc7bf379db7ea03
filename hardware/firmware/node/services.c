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

enum { SUPPRESS = 0x80, ANSWER_TIME_MS = 1000, PENDING_TIME_10MS = 500, READ_HEAD = 3, JOURNAL_RECORDS_MAX = 100 };

static size_t put_numbers(uint8_t *to, const uint32_t *numbers, size_t count) {
    for (size_t k = 0; k < count; k++)
        put_u32(to + 4 * k, numbers[k]);
    return 4 * count;
}

static uint8_t flags_of(const Node *node) {
    return (uint8_t)((node->needs_operator ? 1 : 0) | (node->stop_active ? 2 : 0) | (node->pattern_loaded ? 4 : 0) |
                     (node->dry ? 8 : 0) | (node->scanned ? 16 : 0) | (node->journal.damaged ? 32 : 0) |
                     (node->options.by_watchdog ? 64 : 0));
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
    const size_t records = (room < BLOCK_MAX ? room : BLOCK_MAX) / RECORD_BYTES;
    const uint32_t most = records < JOURNAL_RECORDS_MAX ? (uint32_t)records : JOURNAL_RECORDS_MAX;
    return journal_read(&node->journal, to, most) * RECORD_BYTES;
}

static size_t read_identifier(const Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room) {
    if (length != READ_HEAD)
        return uds_refusal(answer, UDS_READ, UDS_LENGTH);
    uint8_t *to = answer + READ_HEAD;
    size_t size = 0;
    switch (get_u16(request + 1)) {
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

static size_t session(const uint8_t *request, size_t length, uint8_t *answer) {
    if (length != 2)
        return uds_refusal(answer, UDS_SESSION, UDS_LENGTH);
    const uint8_t kind = request[1] & (uint8_t)~SUPPRESS;
    if (kind != 1 && kind != 3) /* default, extended: the same here */
        return uds_refusal(answer, UDS_SESSION, UDS_SUBFUNCTION_NOT_SUPPORTED);
    answer[0] = UDS_SESSION + UDS_POSITIVE;
    answer[1] = kind;
    put_u16(answer + 2, ANSWER_TIME_MS);
    put_u16(answer + 4, PENDING_TIME_10MS);
    return request[1] & SUPPRESS ? 0 : 6;
}

static size_t tester_present(const uint8_t *request, size_t length, uint8_t *answer) {
    if (length != 2)
        return uds_refusal(answer, UDS_TESTER_PRESENT, UDS_LENGTH);
    if ((request[1] & (uint8_t)~SUPPRESS) != 0)
        return uds_refusal(answer, UDS_TESTER_PRESENT, UDS_SUBFUNCTION_NOT_SUPPORTED);
    answer[0] = UDS_TESTER_PRESENT + UDS_POSITIVE;
    answer[1] = 0;
    return request[1] & SUPPRESS ? 0 : 2;
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

size_t services_answer(Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room, Cause *cause) {
    if (length == 0 || room < ANSWER_ROOM)
        return 0;
    switch (request[0]) {
    case UDS_SESSION:
        return session(request, length, answer);
    case UDS_TESTER_PRESENT:
        return tester_present(request, length, answer);
    case UDS_READ:
        return read_identifier(node, request, length, answer, room);
    case UDS_ROUTINE_CONTROL:
        return routine_control(node, request, length, answer, cause);
    case UDS_DOWNLOAD:
    case UDS_UPLOAD:
    case UDS_TRANSFER:
    case UDS_TRANSFER_EXIT:
        return transfer(node, request, length, answer, room, cause);
    default:
        return uds_refusal(answer, request[0], UDS_SERVICE_NOT_SUPPORTED);
    }
}
