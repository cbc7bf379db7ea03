/* Both ends of ISO-TP. Odd inputs: frames of any content at any time into one end. Even ones: two ends, a wire that
 * loses, doubles and cuts frames; what arrives is what was sent. */
#include "isotp.h"

#include <string.h>

#include "input.h"

enum { A_TO_B = 0x640, B_TO_A = 0x641, TURNS_MAX = 4000, SPOILT_MAX = 15 };

static IsotpOptions options_of(Input *input, uint32_t receive_id, uint32_t send_id) {
    return (IsotpOptions){.receive_id = receive_id,
                          .send_id = send_id,
                          .block_size = input_byte(input),
                          .separation = input_byte(input),
                          .padding = 0xCC,
                          .wait_max = 3,
                          .flow_timeout = 1000,
                          .frame_timeout = 1000};
}

static void check(const Isotp *end) {
    size_t length;
    const uint8_t *message = isotp_received(end, &length);
    invariant(length <= ISOTP_LENGTH_MAX && (message != NULL) == (length > 0), "a message has 1 to 4095 bytes");
    invariant(end->receiving.position <= ISOTP_LENGTH_MAX && end->sending.position <= ISOTP_LENGTH_MAX, "positions");
    invariant(end->receiving.flow != ISOTP_FLOW_GO || end->receiving.state == ISOTP_RECEIVE_FRAMES,
              "an end that receives nothing asks for no frames");
}

static void check_frame(const Isotp *end, const CanFrame *frame) {
    invariant(frame->id == end->options.send_id && frame->length == CAN_DATA_MAX,
              "frames of eight bytes with the own id");
    invariant(frame->data[0] >> 4 <= 3, "a frame of ISO 15765-2");
}

/* Frames of any content. */
static void take_anything(Input *input) {
    Isotp *end = malloc(sizeof *end);
    if (!end)
        return;
    const IsotpOptions options = options_of(input, A_TO_B, B_TO_A);
    isotp_init(end, &options);
    uint32_t now = UINT32_MAX - input_word(input);
    uint8_t bytes[ISOTP_LENGTH_MAX + 1];
    memset(bytes, 0x5A, sizeof bytes);
    while (input->left > 0) {
        const uint8_t what = input_byte(input);
        CanFrame frame = {.id = A_TO_B};
        size_t length;
        switch (what % 6) {
        case 0: /* the time of a turn, or one that is too long */
            now += input_word(input);
            isotp_tick(end, now);
            break;
        case 1:
            frame.length = input_byte(input) % (CAN_DATA_MAX + 1);
            input_fill(input, frame.data, frame.length);
            isotp_take(end, &frame, now);
            break;
        case 2:
            if (isotp_next(end, now, &frame))
                check_frame(end, &frame);
            break;
        case 3:
            isotp_send(end, bytes, input_word(input) % (sizeof bytes + 1));
            break;
        case 4:
            if (isotp_received(end, &length))
                isotp_release(end);
            break;
        default: /* the next frame of the message that comes, so that long ones end */
            frame.length = CAN_DATA_MAX;
            frame.data[0] = (uint8_t)(0x20u | end->receiving.sequence);
            isotp_take(end, &frame, now);
        }
        check(end);
    }
    free(end);
}

/* Moves the frames of one end to the other. Some do not arrive, come twice, or are cut short. */
static void move(Isotp *from, Isotp *to, uint32_t now, Input *input, int *spoilt) {
    enum { LOST, DOUBLED, SHORT };
    CanFrame frame;
    while (isotp_next(from, now, &frame)) {
        check_frame(from, &frame);
        const uint8_t fate = input->left > 0 && *spoilt < SPOILT_MAX ? input_byte(input) : UINT8_MAX;
        *spoilt += fate <= SHORT;
        if (fate == SHORT) {
            frame.length = 2;
            memset(frame.data + 2, 0, CAN_DATA_MAX - 2);
        }
        if (fate != LOST)
            isotp_take(to, &frame, now);
        if (fate == DOUBLED)
            isotp_take(to, &frame, now);
        check(to);
    }
}

static void exchange(Input *input) {
    Isotp *a = malloc(sizeof *a), *b = malloc(sizeof *b);
    uint8_t sent[ISOTP_LENGTH_MAX];
    if (a && b) {
        const IsotpOptions left = options_of(input, B_TO_A, A_TO_B), right = options_of(input, A_TO_B, B_TO_A);
        isotp_init(a, &left);
        isotp_init(b, &right);
        const size_t length = 1 + input_word(input) % ISOTP_LENGTH_MAX;
        for (size_t k = 0; k < length; k++)
            sent[k] = (uint8_t)(k / 7 * 31 + k);
        invariant(isotp_send(a, sent, length), "an idle end sends");
        uint32_t now = UINT32_MAX - 100;
        int spoilt = 0;
        size_t got = 0;
        const uint8_t *found = NULL;
        for (int turn = 0; turn < TURNS_MAX && !found && (isotp_is_sending(a) || turn < 2); turn++) {
            move(a, b, now, input, &spoilt);
            move(b, a, now, input, &spoilt);
            found = isotp_received(b, &got);
            now += 128;
            isotp_tick(a, now);
            isotp_tick(b, now);
        }
        invariant(!found || (got == length && memcmp(found, sent, length) == 0), "what arrives is what was sent");
        invariant(found || spoilt > 0, "with no frame spoilt every message arrives");
        now += 2000;
        isotp_tick(a, now);
        isotp_tick(b, now);
        invariant(!isotp_is_sending(a) && b->receiving.state != ISOTP_RECEIVE_FRAMES, "no end waits forever");
    }
    free(a);
    free(b);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t length) {
    Input input = {.bytes = bytes, .left = length};
    if (input_byte(&input) % 2)
        take_anything(&input);
    else
        exchange(&input);
    return 0;
}
