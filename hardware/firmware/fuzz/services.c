/* Requests, ticks, masters, faults and power failures in any order, on a node with any roles. The first bytes choose
 * roles, sectors, room for answers and clock; then each operation is a byte and what it takes. */
#include "services.h"

#include <string.h>

#include "board.h"
#include "bytes.h"
#include "crc32.h"
#include "height_map.h"
#include "interlocks.h"
#include "requests.h"
#include "uds.h"

enum {
    ALIVE_EVERY = 100,
    TICK = 10,
    ENDS_WITHIN = 300 /* ticks */,
    ALL_ENABLES = ENABLE_LAMP | ENABLE_GATE | ENABLE_MOTION
};

typedef struct {
    FuzzBoard board;
    Node node;
    NodeOptions options;
    Input input;
    size_t room;
    uint32_t alive_at;
    MasterAlive master;
    uint32_t upload_of;        /* number of the scan whose map is under way */
    uint8_t *request, *answer; /* in memory of just their size */
} Bench;

static void turn(Bench *bench, uint32_t milliseconds) {
    bench->board.now += milliseconds;
    node_tick(&bench->node, bench->board.now);
    fuzz_board_check(&bench->board);
}

static void say_alive(Bench *bench, const MasterAlive *master) {
    fuzz_board_master_alive(&bench->board, master);
    node_master_alive(&bench->node, bench->board.now, master);
    bench->alive_at = bench->board.now;
}

/* Time as it should pass: a tick every 10 ms, a living master. */
static void live(Bench *bench, int ticks) {
    for (int k = 0; k < ticks; k++) {
        if (bench->board.now - bench->alive_at >= ALIVE_EVERY)
            say_alive(bench, &bench->master);
        turn(bench, TICK);
    }
}

static void power_up(Bench *bench) {
    fuzz_board_power_off(&bench->board);
    bench->board.now += TICK;
    memset(bench->options.pattern_memory, 0xA5, bench->options.pattern_bytes);
    node_init(&bench->node, &bench->options, &bench->board.hal, bench->board.now);
    law(bench->node.state == NODE_SAFE || bench->node.state == NODE_FAULT, "every node wakes up off");
}

static void check_transfer(Bench *bench, const uint8_t *answer) {
    const bool upload = bench->node.transfer.upload;
    if (answer[0] == UDS_UPLOAD + UDS_POSITIVE)
        bench->upload_of = bench->board.scans;
    if (answer[0] == UDS_TRANSFER + UDS_POSITIVE && upload)
        law(bench->upload_of == bench->board.scans, "all blocks of a map are of one scan");
}

static void check_answer(Bench *bench, const uint8_t *request, const uint8_t *answer, size_t length) {
    law(length <= bench->room, "answers fit their room");
    if (length == 0) {
        law(request[0] == UDS_SESSION || request[0] == UDS_TESTER_PRESENT, "only these may be silent");
        return;
    }
    const bool refused = answer[0] == UDS_NEGATIVE;
    law(refused ? length == 3 && answer[1] == request[0] && answer[2] != UDS_OK
                : answer[0] == (uint8_t)(request[0] + UDS_POSITIVE),
        "an answer is of its request");
    if (!refused)
        check_transfer(bench, answer);
    const bool known = answer[0] == UDS_ROUTINE_CONTROL + UDS_POSITIVE && answer[4] == OUTCOME_DONE_BEFORE;
    const Key key = length == 13 ? uds_key(answer + 5) : (Key){0}, seen = bench->board.seen;
    if (known && get_u16(answer + 2) == ROUTINE_SCAN && !bench->node.dry)
        law(key.job == seen.job && key.layer == seen.layer && key.attempt == seen.attempt, "what was scanned was seen");
}

static void forget(Bench *bench) {
    free(bench->request);
    free(bench->answer);
    bench->request = bench->answer = NULL;
}

/* What the node says at once goes to `first`. */
static void ask(Bench *bench, const uint8_t *bytes, size_t length, uint8_t first[ANSWER_ROOM]) {
    forget(bench);
    bench->request = malloc(length ? length : 1);
    bench->answer = malloc(bench->room);
    memset(first, 0, ANSWER_ROOM);
    if (!bench->request || !bench->answer)
        return;
    memcpy(bench->request, bytes, length);
    const size_t answered =
        node_request(&bench->node, bench->board.now, bench->request, length, bench->answer, bench->room);
    if (length > 0)
        check_answer(bench, bench->request, bench->answer, answered);
    memcpy(first, bench->answer, answered < ANSWER_ROOM ? answered : ANSWER_ROOM);
}

static bool is_pending(const uint8_t *answer) {
    return answer[0] == UDS_NEGATIVE && answer[2] == UDS_PENDING;
}

static void ask_once(Bench *bench, const uint8_t *request, size_t length) {
    uint8_t first[ANSWER_ROOM];
    ask(bench, request, length, first);
}

/* To the end of the step; what was done is then done before. */
static void ask_to_the_end(Bench *bench, const uint8_t *request, size_t length) {
    uint8_t first[ANSWER_ROOM];
    ask(bench, request, length, first);
    const bool busy = is_pending(first);
    for (int k = 0; k < ENDS_WITHIN && is_pending(first); k++) {
        live(bench, 1);
        node_take_answer(&bench->node, first, sizeof first);
    }
    const bool done = first[0] == UDS_ROUTINE_CONTROL + UDS_POSITIVE && first[4] == OUTCOME_DONE;
    if (!busy || !done || request[1] != UDS_START || bench->node.dry)
        return;
    const uint32_t before = bench->board.jets + bench->board.scans;
    ask(bench, request, length, first);
    law(first[4] == OUTCOME_DONE_BEFORE, "a repeat of what is done is done before");
    law(bench->board.jets + bench->board.scans == before && bench->node.step.kind == STEP_NONE, "and does nothing");
}

static void bring_to_work(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX];
    bench->board.broken = 0;
    node_supervision(&bench->node, bench->board.now, true);
    node_stop_request(&bench->node, bench->board.now, false);
    bench->master.enables = ALL_ENABLES;
    live(bench, 40);
    ask_once(bench, request, fuzz_request_clear(request));
    if (!node_has(&bench->node, ROLE_STAGE))
        return;
    put_u16(request + 2, ROUTINE_HOME);
    ask_to_the_end(bench, request, 12);
}

static void download(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX], pattern[FUZZ_REQUEST_MAX];
    const uint8_t form = input_byte(&bench->input);
    const size_t size = fuzz_pattern(&bench->input, pattern), block = 1 + (form >> 5);
    uint8_t counter = 1;
    ask_once(bench, request, fuzz_request_download(form & 7, form & 8, (uint32_t)size, request));
    for (size_t at = 0; at < size; at += block, counter++) {
        const size_t bytes = size - at < block ? size - at : block;
        request[0] = UDS_TRANSFER;
        request[1] = counter;
        memcpy(request + 2, pattern + at, bytes);
        ask_once(bench, request, 2 + bytes);
    }
    request[0] = UDS_TRANSFER_EXIT;
    put_u32(request + 1, crc32_after(0, pattern, size) ^ (form & 16 ? 1 : 0));
    ask_once(bench, request, 5);
}

static void upload(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX];
    const uint8_t form = input_byte(&bench->input), blocks = form >> 3;
    ask_once(bench, request, fuzz_request_upload(form & 7, height_map_bytes(&bench->board.hal), request));
    for (uint8_t k = 1; k <= blocks; k++) {
        request[0] = UDS_TRANSFER;
        request[1] = k;
        put_u16(request + 2, input_byte(&bench->input));
        ask_once(bench, request, request[3] == 0 ? 2 : 4);
    }
    if (blocks == 31)
        ask_once(bench, (const uint8_t[]){UDS_TRANSFER_EXIT}, 1);
}

static void other_master(Bench *bench) {
    const uint8_t form = input_byte(&bench->input);
    const MasterAlive said = {.enables = form & 7, .session = form >> 3 & 3, .job = 1u + (form >> 7)};
    if (form & 0x40)
        bench->master = said;
    say_alive(bench, &said);
}

static void tamper(Bench *bench) {
    bench->board.tampered = true;
    uint8_t *storage = bench->board.storage;
    const size_t slot = input_byte(&bench->input) % (FUZZ_STORAGE_BYTES / RECORD_BYTES);
    uint8_t *record = storage + slot / 6 * FUZZ_SECTOR_BYTES + slot % 6 * RECORD_BYTES;
    record[input_byte(&bench->input) % RECORD_BYTES] = input_byte(&bench->input);
    if (input_byte(&bench->input) % 2) /* a checksum that is right proves little */
        put_u32(record + RECORD_BYTES - 4, crc32_after(0, record, RECORD_BYTES - 4));
}

static void operate(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX], late[ANSWER_ROOM];
    Input *input = &bench->input;
    switch (input_byte(input) % 16) {
    case 0:
        turn(bench, input_byte(input));
        break;
    case 1:
        live(bench, input_byte(input));
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
        ask_once(bench, request, fuzz_request_raw(input, request));
        break;
    case 6:
        ask_once(bench, request, fuzz_request_routine(input, request));
        break;
    case 7:
        ask_to_the_end(bench, request, fuzz_request_routine(input, request));
        break;
    case 8:
        download(bench);
        break;
    case 9:
        upload(bench);
        break;
    case 10:
        ask_once(bench, request, fuzz_request_read(input, request));
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
        if (input_byte(input) % 2)
            tamper(bench);
        else
            power_up(bench);
    }
    turn(bench, 0);
}

static void begin(Bench *bench, const uint8_t *bytes, size_t length) {
    bench->input = (Input){.bytes = bytes, .left = length};
    const uint8_t form = input_byte(&bench->input), room = input_byte(&bench->input);
    fuzz_board_init(&bench->board, &bench->node, form & 0x10 ? 2 : FUZZ_SECTORS_MAX);
    bench->board.now = form & 0x20 ? UINT32_MAX - 5000 : 1000; /* the clock may wrap */
    bench->room = (size_t)ANSWER_ROOM + room;
    bench->master = (MasterAlive){.enables = ALL_ENABLES, .session = 1, .job = 1};
    bench->options = (NodeOptions){.roles = form & 0xF, .limits = NODE_LIMITS, .pattern_bytes = FUZZ_PATTERN_BYTES};
    bench->options.limits.lamp = 200;
    bench->options.limits.pass = bench->options.limits.motion = bench->options.limits.scan = 1000;
    bench->options.limits.pending = 40;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t length) {
    Bench *bench = calloc(1, sizeof *bench);
    uint8_t *memory = malloc(FUZZ_PATTERN_BYTES);
    if (bench && memory) {
        begin(bench, bytes, length);
        bench->options.pattern_memory = memory;
        if (setjmp(bench->board.power_failure) != 0)
            bench->board.power_fails = false;
        power_up(bench);
        while (bench->input.left > 0)
            operate(bench);
        forget(bench);
    }
    free(memory);
    free(bench);
    return 0;
}
