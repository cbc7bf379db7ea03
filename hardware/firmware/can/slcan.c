#include <string.h>

#include "slcan.h"

enum { CR = '\r', LF = '\n', BEL = '\a', ID_DIGITS = 3, EXTENDED_ID_DIGITS = 8, NO_DIGIT = 16 };

static const char DIGITS[] = "0123456789ABCDEF";

static uint8_t digit(char character) {
    if (character >= '0' && character <= '9')
        return (uint8_t)(character - '0');
    if (character >= 'A' && character <= 'F')
        return (uint8_t)(character - 'A' + 10);
    if (character >= 'a' && character <= 'f')
        return (uint8_t)(character - 'a' + 10);
    return NO_DIGIT;
}

/* Reads `count` hexadecimal digits; false if one of them is something else. */
static bool number(const char *text, int count, uint32_t *value) {
    *value = 0;
    for (int i = 0; i < count; i++) {
        const uint8_t next = digit(text[i]);
        if (next == NO_DIGIT)
            return false;
        *value = *value << 4 | next;
    }
    return true;
}

/* A whole line without its CR, beginning with t, T, r or R, as a frame. */
static bool parse_frame(const char *line, uint8_t used, CanFrame *frame) {
    memset(frame, 0, sizeof *frame);
    frame->extended = line[0] == 'T' || line[0] == 'R';
    frame->remote = line[0] == 'r' || line[0] == 'R';
    const int id_digits = frame->extended ? EXTENDED_ID_DIGITS : ID_DIGITS;
    uint32_t length, byte;
    if (used < 1 + id_digits + 1 || !number(line + 1, id_digits, &frame->id) ||
        !number(line + 1 + id_digits, 1, &length))
        return false;
    if (frame->id > (frame->extended ? (uint32_t)CAN_EXTENDED_ID_MAX : (uint32_t)CAN_ID_MAX) || length > CAN_DATA_MAX)
        return false;
    frame->length = (uint8_t)length;
    const int data_bytes = frame->remote ? 0 : (int)length;
    if (used != 1 + id_digits + 1 + 2 * data_bytes)
        return false;
    for (int i = 0; i < data_bytes; i++) {
        if (!number(line + 1 + id_digits + 1 + 2 * i, 2, &byte))
            return false;
        frame->data[i] = (uint8_t)byte;
    }
    return true;
}

static void answer(SlcanEvent *event, const char *text) {
    event->answer_length = (uint8_t)strlen(text);
    memcpy(event->answer, text, event->answer_length);
}

static bool refuse(Slcan *slcan, SlcanEvent *event) {
    slcan->refused++;
    answer(event, "\a");
    return true;
}

static bool malformed(Slcan *slcan, SlcanEvent *event) {
    slcan->malformed++;
    answer(event, "\a");
    return true;
}

static bool take_frame(Slcan *slcan, SlcanEvent *event) {
    if (!parse_frame(slcan->line, slcan->used, &event->frame))
        return malformed(slcan, event);
    if (!slcan->open || slcan->listen_only)
        return refuse(slcan, event);
    slcan->frames++;
    event->has_frame = true;
    answer(event, event->frame.extended ? "Z\r" : "z\r");
    return true;
}

static bool take_bit_rate(Slcan *slcan, SlcanEvent *event) {
    uint32_t value;
    const bool own = slcan->line[0] == 's';
    if (slcan->used != (own ? 5 : 2) || !number(slcan->line + 1, own ? 4 : 1, &value) ||
        (!own && value > SLCAN_BIT_RATE_MAX))
        return malformed(slcan, event);
    if (slcan->open)
        return refuse(slcan, event);
    answer(event, "\r");
    return true;
}

/* Executes a command. Opening an open channel and closing a closed one is allowed: python-can and slcand both do it. */
static bool take_command(Slcan *slcan, SlcanEvent *event) {
    if (slcan->used != 1)
        return malformed(slcan, event);
    switch (slcan->line[0]) {
    case 'O':
    case 'L':
        slcan->open = true;
        slcan->listen_only = slcan->line[0] == 'L';
        answer(event, "\r");
        return true;
    case 'C':
        slcan->open = false;
        answer(event, "\r");
        return true;
    case 'V':
        answer(event, "V0100\r");
        return true;
    case 'N':
        answer(event, "N0001\r");
        return true;
    case 'F':
        answer(event, "F00\r");
        return true;
    default:
        return malformed(slcan, event);
    }
}

static bool take_line(Slcan *slcan, SlcanEvent *event) {
    switch (slcan->used ? slcan->line[0] : CR) {
    case CR: /* an empty line: hosts send some to clear an adapter's buffer */
        answer(event, "\r");
        return true;
    case 't':
    case 'T':
    case 'r':
    case 'R':
        return take_frame(slcan, event);
    case 'S':
    case 's':
        return take_bit_rate(slcan, event);
    case 'Z':
        if (slcan->used != 2 || (slcan->line[1] != '0' && slcan->line[1] != '1'))
            return malformed(slcan, event);
        if (slcan->line[1] == '1')
            return refuse(slcan, event);
        answer(event, "\r");
        return true;
    default:
        return take_command(slcan, event);
    }
}

void slcan_init(Slcan *slcan) {
    memset(slcan, 0, sizeof *slcan);
}

bool slcan_take(Slcan *slcan, uint8_t byte, SlcanEvent *event) {
    memset(event, 0, sizeof *event);
    if (byte == CR) {
        const bool happened = slcan->overlong ? malformed(slcan, event) : take_line(slcan, event);
        slcan->used = 0;
        slcan->overlong = false;
        return happened;
    }
    if (byte == LF && slcan->used == 0)
        return false;
    if (slcan->used < SLCAN_LINE_MAX)
        slcan->line[slcan->used++] = (char)byte;
    else
        slcan->overlong = true;
    return false;
}

size_t slcan_write(const CanFrame *frame, char line[SLCAN_LINE_MAX]) {
    static const char KINDS[2][2] = {{'t', 'T'}, {'r', 'R'}};
    if (frame->length > CAN_DATA_MAX ||
        frame->id > (frame->extended ? (uint32_t)CAN_EXTENDED_ID_MAX : (uint32_t)CAN_ID_MAX))
        return 0;
    size_t used = 0;
    line[used++] = KINDS[frame->remote][frame->extended];
    for (int shift = 4 * ((frame->extended ? EXTENDED_ID_DIGITS : ID_DIGITS) - 1); shift >= 0; shift -= 4)
        line[used++] = DIGITS[frame->id >> shift & 0xF];
    line[used++] = DIGITS[frame->length];
    for (uint8_t i = 0; !frame->remote && i < frame->length; i++) {
        line[used++] = DIGITS[frame->data[i] >> 4];
        line[used++] = DIGITS[frame->data[i] & 0xF];
    }
    line[used++] = CR;
    return used;
}
