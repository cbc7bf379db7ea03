/* Bytes from a serial line into the adapter's parser: nothing but whole frames of the standard comes out, every line is
 * answered once, and what is written can be read. */
#include "slcan.h"

#include <string.h>

#include "input.h"

static bool same_frame(const CanFrame *left, const CanFrame *right) {
    const size_t bytes = left->remote ? 0 : left->length;
    return left->id == right->id && left->extended == right->extended && left->remote == right->remote &&
           left->length == right->length && memcmp(left->data, right->data, bytes) == 0;
}

/* Frame as the other side reads it. */
static void check_round_trip(const CanFrame *frame) {
    char line[SLCAN_LINE_MAX];
    const size_t length = slcan_write(frame, line);
    invariant(length > 0 && length <= SLCAN_LINE_MAX && line[length - 1] == '\r',
              "a frame that was read can be written");
    Slcan other;
    SlcanEvent event = {0};
    slcan_init(&other);
    slcan_take(&other, 'O', &event);
    slcan_take(&other, '\r', &event);
    for (size_t k = 0; k < length; k++)
        invariant(slcan_take(&other, (uint8_t)line[k], &event) == (k + 1 == length), "one line is one event");
    invariant(event.has_frame && same_frame(&event.frame, frame), "a frame that was written is read as it was");
}

static void check_event(const Slcan *slcan, const SlcanEvent *event) {
    invariant(event->answer_length > 0 && event->answer_length <= SLCAN_ANSWER_MAX, "every line is answered");
    const char last = event->answer[event->answer_length - 1];
    invariant(last == '\r' || (last == '\a' && event->answer_length == 1), "an answer ends with CR, or is BEL");
    if (!event->has_frame)
        return;
    invariant(slcan->open && !slcan->listen_only, "frames go out through an open channel only");
    invariant(event->frame.id <= (event->frame.extended ? (uint32_t)CAN_EXTENDED_ID_MAX : (uint32_t)CAN_ID_MAX), "id");
    invariant(event->frame.length <= CAN_DATA_MAX, "at most eight bytes");
    check_round_trip(&event->frame);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t length) {
    Slcan *slcan = malloc(sizeof *slcan);
    if (!slcan)
        return 0;
    slcan_init(slcan);
    for (size_t k = 0; k < length; k++) {
        const uint32_t before = slcan->frames + slcan->malformed + slcan->refused;
        SlcanEvent event;
        const bool happened = slcan_take(slcan, bytes[k], &event);
        invariant(happened == (bytes[k] == '\r'), "a line ends with CR, and only with it");
        if (happened)
            check_event(slcan, &event);
        else
            invariant(!event.has_frame && event.answer_length == 0, "nothing before the end of a line");
        invariant(slcan->frames + slcan->malformed + slcan->refused <= before + (happened ? 1 : 0),
                  "a line counts once");
        invariant(slcan->used <= SLCAN_LINE_MAX, "a line stays in its buffer");
    }
    free(slcan);
    return 0;
}
