/* Requests, ticks, masters, faults and power failures in any order, on a node with any roles. The first bytes choose
 * roles, sectors, room for answers and clock; then each operation is a byte and what it takes. */
#include <string.h>

#include "asking.h"
#include "bytes.h"
#include "crc32.h"
#include "height_map.h"
#include "requests.h"
#include "uds.h"

enum { ALL_ENABLES = ENABLE_LAMP | ENABLE_GATE | ENABLE_MOTION };

static void bring_to_work(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX];
    bench->board.broken = 0;
    node_supervision(&bench->node, bench->board.now, true);
    node_stop_request(&bench->node, bench->board.now, false);
    bench->master.enables = ALL_ENABLES;
    bench_live(bench, 40);
    bench_ask_once(bench, request, fuzz_request_clear(request));
    if (!node_has(&bench->node, ROLE_STAGE))
        return;
    put_u16(request + 2, ROUTINE_HOME);
    bench_ask_to_the_end(bench, request, 12);
}

static void download(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX], pattern[FUZZ_REQUEST_MAX];
    const uint8_t form = input_byte(&bench->input);
    const size_t size = fuzz_pattern(&bench->input, pattern), block = 1 + (form >> 5);
    uint8_t counter = 1;
    bench_ask_once(bench, request, fuzz_request_download(form & 7, form & 8, (uint32_t)size, request));
    for (size_t at = 0; at < size; at += block, counter++) {
        const size_t bytes = size - at < block ? size - at : block;
        request[0] = UDS_TRANSFER;
        request[1] = counter;
        memcpy(request + 2, pattern + at, bytes);
        bench_ask_once(bench, request, 2 + bytes);
    }
    request[0] = UDS_TRANSFER_EXIT;
    const bool altered = form & 16;
    put_u32(request + 1, crc32_after(0, pattern, size) ^ (altered ? 1 : 0));
    invariant(!bench_ask_once(bench, request, 5) || !altered, "a pattern with another checksum is refused");
}

static void upload(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX];
    const uint8_t form = input_byte(&bench->input), blocks = form >> 3;
    bench_ask_once(bench, request, fuzz_request_upload(form & 7, height_map_bytes(&bench->board.hal), request));
    for (uint8_t k = 1; k <= blocks; k++) {
        request[0] = UDS_TRANSFER;
        request[1] = k;
        put_u16(request + 2, input_byte(&bench->input));
        bench_ask_once(bench, request, request[3] == 0 ? 2 : 4);
    }
    if (blocks == 31)
        bench_ask_once(bench, (const uint8_t[]){UDS_TRANSFER_EXIT}, 1);
}

static void other_master(Bench *bench) {
    const uint8_t form = input_byte(&bench->input);
    const MasterAlive sent = {.enables = form & 7, .session = form >> 3 & 3, .job = 1u + (form >> 7)};
    if (form & 0x40)
        bench->master = sent;
    bench_send_alive(bench, &sent);
}

static void tamper(Bench *bench) {
    bench->board.tampered = true;
    uint8_t *storage = bench->board.storage;
    enum { IN_SECTOR = FUZZ_SECTOR_BYTES / RECORD_BYTES };
    const size_t slot = input_byte(&bench->input) % (FUZZ_SECTORS_MAX * IN_SECTOR);
    uint8_t *record = storage + slot / IN_SECTOR * FUZZ_SECTOR_BYTES + slot % IN_SECTOR * RECORD_BYTES;
    record[input_byte(&bench->input) % RECORD_BYTES] = input_byte(&bench->input);
    if (input_byte(&bench->input) % 2) /* a checksum that is right proves little */
        put_u32(record + RECORD_BYTES - 4, crc32_after(0, record, RECORD_BYTES - 4));
}

/* With all records, with an altered one, or with some that cannot be read then. */
static void power_up(Bench *bench) {
    const uint8_t how = input_byte(&bench->input) % 3;
    if (how == 1) {
        tamper(bench);
        return;
    }
    bench->board.blind_from = how == 2 ? 1 + 3u * input_byte(&bench->input) : 0;
    bench_power_up(bench);
    bench->board.blind_from = 0;
}

static void operate(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX], late[ANSWER_ROOM];
    Input *input = &bench->input;
    switch (input_byte(input) % 16) {
    case 0:
        bench_turn(bench, input_byte(input));
        break;
    case 1:
        bench_live(bench, input_byte(input));
        break;
    case 2:
        other_master(bench);
        break;
    case 3:
        node_supervision(&bench->node, bench->board.now, input_byte(input) % 2);
        break;
    case 4:
        node_stop_request(&bench->node, bench->board.now, input_byte(input) % 2);
        break;
    case 5:
        bench_ask_once(bench, request, fuzz_request_raw(input, request));
        break;
    case 6:
        bench_ask_once(bench, request, fuzz_request_routine(input, request));
        break;
    case 7:
        bench_ask_to_the_end(bench, request, fuzz_request_routine(input, request));
        break;
    case 8:
        download(bench);
        break;
    case 9:
        upload(bench);
        break;
    case 10:
        bench_ask_once(bench, request, fuzz_request_read(input, request));
        break;
    case 11:
        bench->board.broken = input_byte(input);
        break;
    case 12:
        bench->board.written = input_byte(input);
        bench->board.power_fails = true;
        break;
    case 13:
        node_take_answer(&bench->node, late, input_byte(input) % (sizeof late + 1));
        break;
    case 14:
        bring_to_work(bench);
        break;
    default:
        power_up(bench);
    }
    bench_turn(bench, 0);
}

static void begin(Bench *bench, uint8_t *memory, const uint8_t *bytes, size_t length) {
    bench->input = (Input){.bytes = bytes, .left = length};
    const uint8_t form = input_byte(&bench->input), room = input_byte(&bench->input);
    fuzz_board_init(&bench->board, &bench->node, form & 0x10 ? 2 : FUZZ_SECTORS_MAX);
    bench->board.now = form & 0x20 ? UINT32_MAX - 5000 : 1000; /* the clock may wrap */
    bench->room = (size_t)ANSWER_ROOM + room;
    bench->master = (MasterAlive){.enables = ALL_ENABLES, .session = 1, .job = 1};
    bench->options = fuzz_options(form, memory);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t length) {
    Bench *bench = calloc(1, sizeof *bench);
    uint8_t *memory = malloc(FUZZ_PATTERN_BYTES);
    if (bench && memory) {
        begin(bench, memory, bytes, length);
        if (setjmp(bench->board.power_failure) != 0)
            bench->board.power_fails = false;
        bench_power_up(bench);
        while (bench->input.left > 0)
            operate(bench);
        bench_forget(bench);
    }
    free(memory);
    free(bench);
    return 0;
}
