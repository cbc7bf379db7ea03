#include "frame_faults.h"

#include <string.h>

#include "e2e.h"
#include "inkloop.h"
#include "inkloop_protocol.h"
#include "random.h"

enum { ALTERED = 90, GARBLED = 91, FORMS = 5, COUNTER_MASK = 0xF };

static uint32_t choose(const Fault *fault, int stream, uint32_t among) {
    return (uint32_t)(random_uniform(fault->seed, (Stream)stream, fault->number, (int32_t)(fault->hits & INT32_MAX)) *
                      among);
}

void frame_corrupt(CanFrame *frame, const Fault *fault) {
    if (frame->length == 0)
        return;
    const uint32_t place = choose(fault, ALTERED, 8u * frame->length);
    const uint32_t byte = fault->byte == ANY ? place / 8 : (uint32_t)fault->byte % frame->length;
    frame->data[byte] ^= (uint8_t)(1u << place % 8);
}

/* Data ids count up with the ids of the frames. */
static uint16_t data_id(uint32_t id) {
    if (id == INKLOOP_STOP_REQUEST_FRAME_ID)
        return INKLOOP_STOP_REQUEST_DATA_ID;
    if (id == INKLOOP_MASTER_ALIVE_FRAME_ID)
        return INKLOOP_MASTER_ALIVE_DATA_ID;
    return (uint16_t)(INKLOOP_HEAD_STATUS_DATA_ID + id - INKLOOP_HEAD_STATUS_FRAME_ID);
}

void frame_hold_counter(CanFrame *frame, uint8_t counter) {
    e2e_protect(frame->data, frame->length, data_id(frame->id), counter & COUNTER_MASK);
}

void frame_spoil_check(CanFrame *frame) {
    frame->data[0] ^= 0xFF;
}

size_t frame_garble(const CanFrame *frame, const Fault *fault, char line[2 * SLCAN_LINE_MAX]) {
    size_t length = slcan_write(frame, line);
    switch (choose(fault, GARBLED, FORMS)) {
    case 0: /* its end is missing */
        length = length / 2;
        line[length++] = '\r';
        break;
    case 1: /* no digit */
        line[length / 2] = '?';
        break;
    case 2: /* more bytes than a frame has */
        line[4] = '9';
        break;
    case 3: /* no letter that begins a line */
        line[0] = '\xff';
        break;
    default: /* two lines in one */
        memcpy(line + length - 1, line, length - 1);
        length = 2 * (length - 1);
        line[length++] = '\r';
    }
    return length;
}
