/* Frames of a bus, good and bad, in any order and at any time, at a node with any roles: only what passes its checks
 * acts, and every frame that the node sends is right. The first byte chooses roles, sectors and clock; then each
 * operation is a byte and what it takes. */
#include "bytes.h"
#include "crc32.h"
#include "e2e.h"
#include "inkloop.h"
#include "inkloop_protocol.h"
#include "requests.h"
#include "uds.h"
#include "wire.h"

enum { ALL_ENABLES = ENABLE_LAMP | ENABLE_GATE | ENABLE_MOTION };

static void bring_to_work(Wire *wire) {
    uint8_t request[FUZZ_REQUEST_MAX];
    wire->board.broken = 0;
    wire->lose = 0;
    wire->master.enables = ALL_ENABLES;
    for (uint8_t counter = 0; counter < 3; counter++) {
        CanFrame frame = {.id = INKLOOP_STOP_REQUEST_FRAME_ID, .length = INKLOOP_STOP_REQUEST_LENGTH};
        e2e_protect(frame.data, frame.length, INKLOOP_STOP_REQUEST_DATA_ID, counter);
        wire_give(wire, &frame);
    }
    wire_live(wire, 60);
    wire_ask(wire, request, fuzz_request_clear(request));
    if (!node_has(&wire->node, ROLE_STAGE))
        return;
    put_u16(request + 2, ROUTINE_HOME);
    wire_ask(wire, request, 12);
}

static void download(Wire *wire) {
    uint8_t request[FUZZ_REQUEST_MAX];
    const uint8_t form = input_byte(&wire->input);
    const size_t size = fuzz_pattern(&wire->input, request + 2);
    const uint32_t crc = crc32_after(0, request + 2, size) ^ (form & 16 ? 1 : 0);
    uint8_t head[11];
    wire_ask(wire, head, fuzz_request_download(form & 7, form & 8, (uint32_t)size, head));
    request[0] = UDS_TRANSFER;
    request[1] = 1;
    wire_ask(wire, request, 2 + size);
    request[0] = UDS_TRANSFER_EXIT;
    put_u32(request + 1, crc);
    wire_ask(wire, request, 5);
}

static void any_frame(Wire *wire) {
    static const uint32_t IDS[] = {INKLOOP_STOP_REQUEST_FRAME_ID, INKLOOP_MASTER_ALIVE_FRAME_ID};
    const uint8_t form = input_byte(&wire->input), length = input_byte(&wire->input) % (CAN_DATA_MAX + 1);
    CanFrame frame = {.length = length, .extended = form >= 0xF0, .remote = (form & 0xF0) == 0xE0};
    frame.id = form & 8 ? input_word(&wire->input) : form & 4 ? wire->frames.link.options.receive_id : IDS[form & 1];
    input_fill(&wire->input, frame.data, length);
    wire_give(wire, &frame);
}

/* A heartbeat: of another master, with a wrong counter, or damaged on its way. */
static void heartbeat(Wire *wire) {
    const uint8_t form = input_byte(&wire->input), fault = input_byte(&wire->input);
    const MasterAlive sent = {.enables = form & 7, .session = form >> 3 & 3, .job = 1u + (form >> 7)};
    if (form & 0x40)
        wire->master = sent;
    if (fault >> 4 < E2E_COUNTER_MAX)
        wire->counter = (uint8_t)((wire->counter + (fault >> 4)) % (E2E_COUNTER_MAX + 1));
    CanFrame frame = wire_alive_frame(wire, &sent);
    const bool damaged = fault & 8;
    if (damaged)
        frame.data[1 + fault % 7] ^= (uint8_t)(1u << (fault & 7));
    const bool seen = wire->node.master_seen;
    wire->board.now++;
    wire_give(wire, &frame);
    invariant(!damaged || (wire->node.times.master_alive != wire->board.now && wire->node.master_seen == seen),
              "a damaged heartbeat is none");
}

static void stop_request(Wire *wire) {
    const uint8_t form = input_byte(&wire->input);
    const struct inkloop_stop_request_t signals = {.active = form & 1};
    CanFrame frame = {.id = INKLOOP_STOP_REQUEST_FRAME_ID, .length = INKLOOP_STOP_REQUEST_LENGTH};
    inkloop_stop_request_pack(frame.data, &signals, sizeof frame.data);
    e2e_protect(frame.data, frame.length, INKLOOP_STOP_REQUEST_DATA_ID, form >> 4 & 7);
    if (form & 2)
        frame.data[0] ^= 0x10;
    const bool before = wire->node.stop_active, whole = !(form & 2);
    wire_give(wire, &frame);
    invariant(wire->node.stop_active || !(whole && (form & 1)), "a stop request acts when it is whole");
    invariant(wire->node.stop_active == before || whole, "a damaged one changes nothing");
    invariant(!wire->node.stop_active || node_is_off(&wire->node), "and puts the node off");
}

static void operate(Wire *wire) {
    uint8_t request[FUZZ_REQUEST_MAX];
    Input *input = &wire->input;
    switch (input_byte(input) % 13) {
    case 0:
        wire_turn(wire, input_byte(input));
        break;
    case 1:
        wire_live(wire, input_byte(input));
        break;
    case 2:
        any_frame(wire);
        break;
    case 3:
        heartbeat(wire);
        break;
    case 4:
        stop_request(wire);
        break;
    case 5:
        wire_ask(wire, request, fuzz_request_routine(input, request));
        break;
    case 6:
        wire_ask(wire, request, fuzz_request_raw(input, request));
        break;
    case 7:
        wire_ask(wire, request, fuzz_request_read(input, request));
        break;
    case 8:
        download(wire);
        break;
    case 9:
        wire->board.broken = input_byte(input);
        break;
    case 10:
        wire->lose = input_byte(input);
        break;
    case 11:
        wire->board.written = input_byte(input);
        wire->board.power_fails = true;
        if (wire->board.written % 2 == 0)
            wire_power_up(wire);
        break;
    default:
        bring_to_work(wire);
    }
}

static void begin(Wire *wire, uint8_t *memory, const uint8_t *bytes, size_t length) {
    wire->input = (Input){.bytes = bytes, .left = length};
    const uint8_t form = input_byte(&wire->input);
    fuzz_board_init(&wire->board, &wire->node, form & 0x10 ? 2 : FUZZ_SECTORS_MAX);
    wire->board.now = form & 0x20 ? UINT32_MAX - 5000 : 1000; /* the clock may wrap */
    wire->frames.number = form >> 6;
    wire->master = (MasterAlive){.enables = ALL_ENABLES, .session = 1, .job = 1};
    wire->options = fuzz_options(form, memory);
    const uint32_t request = INKLOOP_HEAD_REQUEST_FRAME_ID + 2u * wire->frames.number;
    const IsotpOptions tester = {.receive_id = request + 1,
                                 .send_id = request,
                                 .block_size = form & 0x10 ? 3 : 0,
                                 .wait_max = 8,
                                 .flow_timeout = 1000,
                                 .frame_timeout = 1000};
    isotp_init(&wire->tester, &tester);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t length) {
    Wire *wire = calloc(1, sizeof *wire);
    uint8_t *memory = malloc(FUZZ_PATTERN_BYTES);
    if (wire && memory) {
        begin(wire, memory, bytes, length);
        if (setjmp(wire->board.power_failure) != 0)
            wire->board.power_fails = false;
        wire_power_up(wire);
        while (wire->input.left > 0)
            operate(wire);
    }
    free(memory);
    free(wire);
    return 0;
}
