#include "transfer.h"

#include "bytes.h"
#include "crc32.h"
#include "height_map.h"
#include "layer_order.h"

enum { REQUEST_BYTES = 11, LENGTH_FORMAT = 0x44, PLAIN = 0x00, RUN_LENGTH = 0x10 };
enum { BLOCK_HEAD = 2, MOST_BYTES = 2, CRC_BYTES = 4 };

static size_t accepted(uint8_t *answer, uint8_t service) {
    answer[0] = (uint8_t)(service + UDS_POSITIVE);
    answer[1] = 0x20; /* two bytes of length follow */
    put_u16(answer + 2, BLOCK_MAX);
    return 4;
}

/* Checks the form of 0x34 or 0x35; UDS_OK, or the code that refuses it. */
static uint8_t check_form(const Node *node, const uint8_t *request, size_t length) {
    if (length != REQUEST_BYTES)
        return UDS_LENGTH;
    if (request[2] != LENGTH_FORMAT || get_u32(request + 3) > UINT16_MAX)
        return UDS_OUT_OF_RANGE;
    return node_is_off(node) ? UDS_CONDITIONS : UDS_OK;
}

static void begin(Node *node, bool upload, uint16_t layer, uint32_t size) {
    const NodeState before = node->state == NODE_RECEIVING ? node->transfer.before : node->state;
    node->transfer = (Transfer){.active = true,
                                .upload = upload,
                                .next_counter = 1,
                                .size = size,
                                .layer = layer,
                                .job = node->master.job,
                                .before = before};
}

size_t transfer_download(Node *node, const uint8_t *request, size_t length, uint8_t *answer) {
    uint8_t code = check_form(node, request, length);
    if (code == UDS_OK && request[1] != PLAIN && request[1] != RUN_LENGTH)
        code = UDS_OUT_OF_RANGE;
    if (code == UDS_OK)
        code = order_of_pattern(node, node->master.job, get_u16(request + 5));
    const uint32_t size = code == UDS_OK ? get_u32(request + 7) : 0;
    if (code == UDS_OK && (size <= PATTERN_HEAD_BYTES || size > PATTERN_HEAD_BYTES + 2 * node->options.pattern_bytes))
        code = UDS_OUT_OF_RANGE;
    if (code != UDS_OK)
        return uds_refusal(answer, UDS_DOWNLOAD, code);
    begin(node, false, get_u16(request + 5), size);
    if (node->transfer.before == NODE_VERIFIED) /* the download overwrites that pattern */
        node->transfer.before = NODE_IDLE;
    node->pattern_loaded = false;
    pattern_begin(&node->pattern, request[1] == RUN_LENGTH);
    node->state = NODE_RECEIVING;
    return accepted(answer, UDS_DOWNLOAD);
}

size_t transfer_upload(Node *node, const uint8_t *request, size_t length, uint8_t *answer) {
    uint8_t code = check_form(node, request, length);
    if (code == UDS_OK && (node->state != NODE_MAP_READY || get_u16(request + 5) != node->progress.layer))
        code = UDS_SEQUENCE;
    if (code == UDS_OK && (request[1] != PLAIN || get_u32(request + 7) != height_map_bytes(node->hal)))
        code = UDS_OUT_OF_RANGE;
    if (code != UDS_OK)
        return uds_refusal(answer, UDS_UPLOAD, code);
    begin(node, true, get_u16(request + 5), get_u32(request + 7));
    return accepted(answer, UDS_UPLOAD);
}

/* Ends a download. */
static size_t give_up(Node *node, uint8_t *answer, uint8_t service, uint8_t code) {
    node->state = node->transfer.before;
    node->transfer.active = false;
    return uds_refusal(answer, service, code);
}

static size_t block_answer(const uint8_t *request, uint8_t *answer) {
    answer[0] = UDS_TRANSFER + UDS_POSITIVE;
    answer[1] = request[1];
    return BLOCK_HEAD;
}

static void count(Transfer *transfer, const uint8_t *bytes, uint32_t size) {
    transfer->crc_before = transfer->crc;
    transfer->crc = crc32_after(transfer->crc, bytes, size);
    transfer->done += size;
    transfer->last_size = size;
    transfer->next_counter++;
    transfer->any = true;
}

/* Undoes the newest block, which is about to be repeated. */
static void take_back(Transfer *transfer) {
    transfer->crc = transfer->crc_before;
    transfer->done -= transfer->last_size;
    transfer->next_counter--;
}

static uint32_t most_bytes(const uint8_t *request, size_t length, size_t room) {
    const uint32_t fit = (uint32_t)(room < BLOCK_MAX ? room : BLOCK_MAX) - BLOCK_HEAD;
    const uint32_t asked = length == BLOCK_HEAD ? fit : get_u16(request + BLOCK_HEAD);
    return asked < fit ? asked : fit;
}

static size_t give_block(Node *node, const uint8_t *request, uint8_t *answer, uint32_t most, bool repeated) {
    Transfer *transfer = &node->transfer;
    const uint32_t left = repeated ? transfer->last_size : transfer->size - transfer->done;
    const uint32_t size = left < most ? left : most;
    if (most == 0)
        return uds_refusal(answer, UDS_TRANSFER, UDS_OUT_OF_RANGE);
    if (left == 0)
        return uds_refusal(answer, UDS_TRANSFER, UDS_SEQUENCE);
    if (repeated)
        take_back(transfer);
    height_map_read(node->hal, transfer->done, answer + BLOCK_HEAD, size);
    count(transfer, answer + BLOCK_HEAD, size);
    return block_answer(request, answer) + size;
}

static size_t take_block(Node *node, const uint8_t *request, size_t length, uint8_t *answer) {
    Transfer *transfer = &node->transfer;
    const uint32_t size = (uint32_t)length - BLOCK_HEAD;
    if (size > transfer->size - transfer->done)
        return give_up(node, answer, UDS_TRANSFER, UDS_SUSPENDED);
    if (!pattern_take(&node->pattern, request + BLOCK_HEAD, size))
        return give_up(node, answer, UDS_TRANSFER, UDS_OUT_OF_RANGE);
    count(transfer, request + BLOCK_HEAD, size);
    return block_answer(request, answer);
}

size_t transfer_block(Node *node, const uint8_t *request, size_t length, uint8_t *answer, size_t room) {
    Transfer *transfer = &node->transfer;
    if (!transfer->active)
        return uds_refusal(answer, UDS_TRANSFER, UDS_SEQUENCE);
    const bool limited = length == (size_t)BLOCK_HEAD + MOST_BYTES;
    if (transfer->upload ? length != BLOCK_HEAD && !limited : length == BLOCK_HEAD)
        return uds_refusal(answer, UDS_TRANSFER, UDS_LENGTH);
    const bool repeated = transfer->any && request[1] == (uint8_t)(transfer->next_counter - 1);
    if (!repeated && request[1] != transfer->next_counter)
        return uds_refusal(answer, UDS_TRANSFER, UDS_COUNTER);
    if (transfer->upload)
        return give_block(node, request, answer, most_bytes(request, length, room), repeated);
    return repeated ? block_answer(request, answer) : take_block(node, request, length, answer);
}

static size_t exit_answer(const Node *node, uint8_t *answer) {
    answer[0] = UDS_TRANSFER_EXIT + UDS_POSITIVE;
    put_u32(answer + 1, node->transfer.crc);
    return 1 + CRC_BYTES;
}

/* Stores a complete pattern as that of its layer; a layer that has begun accepts only its own pattern. */
static uint8_t adopt_pattern(Node *node, Cause *cause) {
    const Transfer *transfer = &node->transfer;
    LayerProgress *progress = &node->progress;
    const bool resumed =
        progress->job == transfer->job && progress->layer == transfer->layer && layer_is_begun(progress);
    if (!pattern_is_complete(&node->pattern) || !pattern_is_printable(&node->pattern))
        return UDS_OUT_OF_RANGE;
    if (resumed && transfer->crc != progress->pattern_crc) /* of its head, too */
        return UDS_CHECKSUM;
    if (!resumed)
        *progress = (LayerProgress){.job = transfer->job,
                                    .layer = transfer->layer,
                                    .pattern_crc = transfer->crc,
                                    .passes = node->pattern.passes,
                                    .boots = progress->boots};
    *cause = node_record(node, RECORD_PATTERN, STEP_NONE, NULL);
    return *cause == CAUSE_NONE ? UDS_OK : UDS_FAILED;
}

static size_t exit_download(Node *node, const uint8_t *request, uint8_t *answer, Cause *cause) {
    if (get_u32(request + 1) != node->transfer.crc) /* the whole pattern has to be sent again */
        return give_up(node, answer, UDS_TRANSFER_EXIT, UDS_CHECKSUM);
    const uint8_t code = adopt_pattern(node, cause);
    if (code == UDS_FAILED)
        return uds_refusal(answer, UDS_TRANSFER_EXIT, code);
    if (code != UDS_OK)
        return give_up(node, answer, UDS_TRANSFER_EXIT, code);
    node->pattern_loaded = true;
    node->scanned = false;
    node->state = layer_is_begun(&node->progress) ? NODE_PRINTED : NODE_VERIFIED;
    return exit_answer(node, answer);
}

size_t transfer_exit(Node *node, const uint8_t *request, size_t length, uint8_t *answer, Cause *cause) {
    Transfer *transfer = &node->transfer;
    const size_t expected = transfer->upload ? 1 : 1 + CRC_BYTES;
    if (!transfer->active && !transfer->ended)
        return uds_refusal(answer, UDS_TRANSFER_EXIT, UDS_SEQUENCE);
    if (length != expected)
        return uds_refusal(answer, UDS_TRANSFER_EXIT, UDS_LENGTH);
    if (!transfer->active) {
        const bool same = transfer->upload || get_u32(request + 1) == transfer->crc;
        return same ? exit_answer(node, answer) : uds_refusal(answer, UDS_TRANSFER_EXIT, UDS_SEQUENCE);
    }
    if (transfer->done != transfer->size)
        return uds_refusal(answer, UDS_TRANSFER_EXIT, UDS_SEQUENCE);
    const size_t answered = transfer->upload ? exit_answer(node, answer) : exit_download(node, request, answer, cause);
    transfer->ended = answer[0] != UDS_NEGATIVE;
    transfer->active = false;
    return answered;
}
