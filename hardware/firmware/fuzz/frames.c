/* Frames of a bus, good and bad, in any order and at any time, at a node with any roles: only what passes its checks
 * acts, and every frame that the node sends is right. The first byte chooses roles, sectors and clock; then each
 * operation is a byte and what it takes. */
#include "node_frames.h"

#include <string.h>

#include "board.h"
#include "bytes.h"
#include "crc32.h"
#include "e2e.h"
#include "inkloop.h"
#include "inkloop_protocol.h"
#include "interlocks.h"
#include "requests.h"
#include "uds.h"

enum { ALIVE_EVERY = 100, TICK = 10, TICKS_MAX = 100 };
enum { ALL_ENABLES = ENABLE_LAMP | ENABLE_GATE | ENABLE_MOTION };

typedef struct {
    FuzzBoard board;
    Node node;
    NodeFrames frames;
    NodeOptions options;
    Input input;
    Isotp tester; /* the master's end */
    MasterAlive master;
    uint8_t counter, status_counter;
    bool status_seen;
    uint32_t alive_at;
    uint8_t lose; /* so many frames go through, then one is lost; 0: none */
} Bench;

static bool is_lost(Bench *bench) {
    return bench->lose > 0 && --bench->lose == 0;
}

static void check_status(Bench *bench, const CanFrame *frame) {
    struct inkloop_head_status_t said;
    const uint16_t data_id = (uint16_t)(INKLOOP_HEAD_STATUS_DATA_ID + bench->frames.number);
    law(e2e_check(frame->data, frame->length, data_id), "a status frame is protected");
    const uint8_t counter = e2e_counter(frame->data);
    law(!bench->status_seen || counter == e2e_next_counter(bench->status_counter), "its counter counts");
    bench->status_counter = counter;
    bench->status_seen = true;
    law(inkloop_head_status_unpack(&said, frame->data, frame->length) == 0, "it can be read");
    law(said.state == (uint8_t)bench->node.state && said.lamp_on == bench->board.lamp &&
            said.gate_open == bench->board.gate,
        "and says what is");
}

/* Frames of both sides until nobody has any. */
static void move(Bench *bench) {
    const uint32_t now = bench->board.now, number = bench->frames.number;
    CanFrame frame;
    bool moved = true;
    while (moved) {
        moved = false;
        while (node_frames_next(&bench->frames, now, &frame)) {
            moved = true;
            law(!frame.extended && !frame.remote && frame.length == CAN_DATA_MAX, "frames of eight bytes");
            if (frame.id == INKLOOP_HEAD_STATUS_FRAME_ID + number)
                check_status(bench, &frame);
            else if (frame.id != INKLOOP_HEAD_FAULT_FRAME_ID + number)
                law(frame.id == bench->tester.options.receive_id, "no other ids");
            if (!is_lost(bench))
                isotp_take(&bench->tester, &frame, now);
        }
        while (isotp_next(&bench->tester, now, &frame)) {
            moved = true;
            if (!is_lost(bench))
                node_frames_take(&bench->frames, &frame, now);
        }
    }
}

static void turn(Bench *bench, uint32_t milliseconds) {
    bench->board.now += milliseconds;
    isotp_tick(&bench->tester, bench->board.now);
    node_frames_tick(&bench->frames, bench->board.now);
    fuzz_board_check(&bench->board);
    move(bench);
}

/* Gives the node a frame; what it takes of a master is told to the board. */
static void give(Bench *bench, const CanFrame *frame) {
    node_frames_take(&bench->frames, frame, bench->board.now);
    if (bench->node.master_seen && bench->node.times.master_alive == bench->board.now)
        fuzz_board_master_alive(&bench->board, &bench->node.master);
    node_tick(&bench->node, bench->board.now);
    fuzz_board_check(&bench->board);
}

static CanFrame alive_frame(Bench *bench, const MasterAlive *master) {
    const struct inkloop_master_alive_t said = {.lamp_enable = (master->enables & ENABLE_LAMP) != 0,
                                                .gate_enable = (master->enables & ENABLE_GATE) != 0,
                                                .motion_enable = (master->enables & ENABLE_MOTION) != 0,
                                                .session = master->session,
                                                .job = master->job};
    CanFrame frame = {.id = INKLOOP_MASTER_ALIVE_FRAME_ID, .length = INKLOOP_MASTER_ALIVE_LENGTH};
    inkloop_master_alive_pack(frame.data, &said, sizeof frame.data);
    e2e_protect(frame.data, frame.length, INKLOOP_MASTER_ALIVE_DATA_ID, bench->counter);
    bench->counter = e2e_next_counter(bench->counter);
    bench->alive_at = bench->board.now;
    return frame;
}

static void live(Bench *bench, int ticks) {
    for (int k = 0; k < ticks; k++) {
        if (bench->board.now - bench->alive_at >= ALIVE_EVERY) {
            const CanFrame frame = alive_frame(bench, &bench->master);
            give(bench, &frame);
        }
        turn(bench, TICK);
    }
}

/* Sends a request and lives until its answer is there or nothing comes. */
static void ask(Bench *bench, const uint8_t *request, size_t length) {
    isotp_abort(&bench->tester);
    if (!isotp_send(&bench->tester, request, length))
        return;
    for (int k = 0; k < TICKS_MAX; k++) {
        size_t answered;
        move(bench);
        live(bench, 1);
        const uint8_t *answer = isotp_received(&bench->tester, &answered);
        if (!answer)
            continue;
        const bool pending = answered == 3 && answer[0] == UDS_NEGATIVE && answer[2] == UDS_PENDING;
        isotp_release(&bench->tester);
        if (!pending)
            return;
    }
}

static void bring_to_work(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX];
    bench->board.broken = 0;
    bench->lose = 0;
    bench->master.enables = ALL_ENABLES;
    CanFrame frame = {.id = INKLOOP_STOP_REQUEST_FRAME_ID, .length = INKLOOP_STOP_REQUEST_LENGTH};
    e2e_protect(frame.data, frame.length, INKLOOP_STOP_REQUEST_DATA_ID, 0);
    give(bench, &frame);
    live(bench, 60);
    ask(bench, request, fuzz_request_clear(request));
    if (!node_has(&bench->node, ROLE_STAGE))
        return;
    put_u16(request + 2, ROUTINE_HOME);
    ask(bench, request, 12);
}

static void download(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX];
    const uint8_t form = input_byte(&bench->input);
    const size_t size = fuzz_pattern(&bench->input, request + 2);
    const uint32_t crc = crc32_after(0, request + 2, size) ^ (form & 16 ? 1 : 0);
    uint8_t head[11];
    ask(bench, head, fuzz_request_download(form & 7, form & 8, (uint32_t)size, head));
    request[0] = UDS_TRANSFER;
    request[1] = 1;
    ask(bench, request, 2 + size);
    request[0] = UDS_TRANSFER_EXIT;
    put_u32(request + 1, crc);
    ask(bench, request, 5);
}

static void any_frame(Bench *bench) {
    static const uint32_t IDS[] = {INKLOOP_STOP_REQUEST_FRAME_ID, INKLOOP_MASTER_ALIVE_FRAME_ID};
    const uint8_t form = input_byte(&bench->input), length = input_byte(&bench->input) % (CAN_DATA_MAX + 1);
    CanFrame frame = {.length = length, .extended = form >= 0xF0, .remote = (form & 0xF0) == 0xE0};
    frame.id = form & 8 ? input_word(&bench->input) : form & 4 ? bench->frames.link.options.receive_id : IDS[form & 1];
    input_fill(&bench->input, frame.data, length);
    give(bench, &frame);
}

/* A heartbeat: of another master, with a wrong counter, or damaged on its way. */
static void heartbeat(Bench *bench) {
    const uint8_t form = input_byte(&bench->input), fault = input_byte(&bench->input);
    const MasterAlive said = {.enables = form & 7, .session = form >> 3 & 3, .job = 1u + (form >> 7)};
    if (form & 0x40)
        bench->master = said;
    if (fault >> 4 < E2E_COUNTER_MAX)
        bench->counter = (uint8_t)((bench->counter + (fault >> 4)) % (E2E_COUNTER_MAX + 1));
    CanFrame frame = alive_frame(bench, &said);
    const bool damaged = fault & 8;
    if (damaged)
        frame.data[1 + fault % 7] ^= (uint8_t)(1u << (fault & 7));
    const bool seen = bench->node.master_seen;
    bench->board.now++;
    give(bench, &frame);
    law(!damaged || (bench->node.times.master_alive != bench->board.now && bench->node.master_seen == seen),
        "a damaged heartbeat is none");
}

static void stop_request(Bench *bench) {
    const uint8_t form = input_byte(&bench->input);
    const struct inkloop_stop_request_t said = {.active = form & 1};
    CanFrame frame = {.id = INKLOOP_STOP_REQUEST_FRAME_ID, .length = INKLOOP_STOP_REQUEST_LENGTH};
    inkloop_stop_request_pack(frame.data, &said, sizeof frame.data);
    e2e_protect(frame.data, frame.length, INKLOOP_STOP_REQUEST_DATA_ID, form >> 4 & 7);
    if (form & 2)
        frame.data[0] ^= 0x10;
    const bool before = bench->node.stop_active;
    give(bench, &frame);
    law(bench->node.stop_active == (form & 2 ? before : (form & 1) != 0), "a stop request acts when it is whole");
    law(!bench->node.stop_active || node_is_off(&bench->node), "and puts the node off");
}

static void power_up(Bench *bench) {
    fuzz_board_power_off(&bench->board);
    bench->board.now += TICK;
    memset(bench->options.pattern_memory, 0xA5, bench->options.pattern_bytes);
    node_init(&bench->node, &bench->options, &bench->board.hal, bench->board.now);
    node_frames_init(&bench->frames, &bench->node, bench->frames.number);
    bench->status_seen = false;
}

static void operate(Bench *bench) {
    uint8_t request[FUZZ_REQUEST_MAX];
    Input *input = &bench->input;
    switch (input_byte(input) % 13) {
    case 0:
        turn(bench, input_byte(input));
        break;
    case 1:
        live(bench, input_byte(input));
        break;
    case 2:
        any_frame(bench);
        break;
    case 3:
        heartbeat(bench);
        break;
    case 4:
        stop_request(bench);
        break;
    case 5:
        ask(bench, request, fuzz_request_routine(input, request));
        break;
    case 6:
        ask(bench, request, fuzz_request_raw(input, request));
        break;
    case 7:
        ask(bench, request, fuzz_request_read(input, request));
        break;
    case 8:
        download(bench);
        break;
    case 9:
        bench->board.broken = input_byte(input);
        break;
    case 10:
        bench->lose = input_byte(input);
        break;
    case 11:
        bench->board.written = input_byte(input);
        bench->board.power_fails = true;
        if (bench->board.written % 2 == 0)
            power_up(bench);
        break;
    default:
        bring_to_work(bench);
    }
}

static void begin(Bench *bench, const uint8_t *bytes, size_t length) {
    bench->input = (Input){.bytes = bytes, .left = length};
    const uint8_t form = input_byte(&bench->input);
    fuzz_board_init(&bench->board, &bench->node, form & 0x10 ? 2 : FUZZ_SECTORS_MAX);
    bench->board.now = form & 0x20 ? UINT32_MAX - 5000 : 1000; /* the clock may wrap */
    bench->frames.number = form >> 6;
    bench->master = (MasterAlive){.enables = ALL_ENABLES, .session = 1, .job = 1};
    bench->options = (NodeOptions){.roles = form & 0xF, .limits = NODE_LIMITS, .pattern_bytes = FUZZ_PATTERN_BYTES};
    bench->options.limits.lamp = 200;
    bench->options.limits.pass = bench->options.limits.motion = bench->options.limits.scan = 1000;
    bench->options.limits.pending = 40;
    const uint32_t request = INKLOOP_HEAD_REQUEST_FRAME_ID + 2u * bench->frames.number;
    const IsotpOptions tester = {.receive_id = request + 1,
                                 .send_id = request,
                                 .block_size = form & 0x10 ? 3 : 0,
                                 .wait_max = 8,
                                 .flow_timeout = 1000,
                                 .frame_timeout = 1000};
    isotp_init(&bench->tester, &tester);
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
    }
    free(memory);
    free(bench);
    return 0;
}
