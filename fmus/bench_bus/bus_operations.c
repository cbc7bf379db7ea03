#include "bus_operations.h"

#include <string.h>

enum {
    FORMAT_ERROR = 0x01,
    CAN_TRANSMIT = 0x10,
    CONFIRM = 0x20,
    ARBITRATION_LOST = 0x30,
    BUS_ERROR = 0x31,
    CONFIGURATION = 0x40,
    STATUS = 0x41,
    WAKEUP = 0x42
};
enum { CAN_BAUDRATE = 1, ARBITRATION_LOST_BEHAVIOR = 4, BUFFER_AND_RETRANSMIT = 1 };
enum { HEAD = 8, TRANSMIT_HEAD = 16, FORMAT_ERROR_HEAD = 10, BIT_RATE_SIZE = 13, BEHAVIOR_SIZE = 10 };
enum { QUOTED_MAX = UINT16_MAX - FORMAT_ERROR_HEAD };
enum { AT_ID = 8, AT_EXTENDED = 12, AT_REMOTE = 13, AT_LENGTH = 14, IS_SENDER = 14 };

static uint32_t read_number(const uint8_t *bytes, int count) {
    uint32_t number = 0;
    for (int k = count - 1; k >= 0; k--)
        number = number << 8 | bytes[k];
    return number;
}

static void write_number(uint8_t *to, uint32_t number, int count) {
    for (int k = 0; k < count; k++)
        to[k] = (uint8_t)(number >> 8 * k);
}

static void write_head(uint8_t *to, uint32_t code, size_t size) {
    write_number(to, code, 4);
    write_number(to + 4, (uint32_t)size, 4);
}

/* False: not the arguments of a frame of classic CAN. */
static bool read_frame(const uint8_t *bytes, size_t size, CanFrame *frame) {
    if (size < TRANSMIT_HEAD)
        return false;
    const uint32_t length = read_number(bytes + AT_LENGTH, 2);
    *frame = (CanFrame){.id = read_number(bytes + AT_ID, 4),
                        .extended = bytes[AT_EXTENDED] == 1,
                        .remote = bytes[AT_REMOTE] == 1,
                        .length = (uint8_t)length};
    if (bytes[AT_EXTENDED] > 1 || bytes[AT_REMOTE] > 1 || length > CAN_DATA_MAX || size != TRANSMIT_HEAD + length ||
        frame->id > (frame->extended ? CAN_EXTENDED_ID_MAX : CAN_ID_MAX))
        return false;
    memcpy(frame->data, bytes + TRANSMIT_HEAD, length);
    return true;
}

static BusOperationKind kind_of(BusOperation *operation) {
    const uint8_t *bytes = operation->bytes;
    const size_t size = operation->size;
    switch (read_number(bytes, 4)) {
    case CAN_TRANSMIT:
        return read_frame(bytes, size, &operation->frame) ? BUS_FRAME : BUS_MALFORMED;
    case FORMAT_ERROR:
        return size >= FORMAT_ERROR_HEAD ? BUS_NOT_READ : BUS_MALFORMED;
    case ARBITRATION_LOST:
        return size == HEAD + 4 ? BUS_FRAME_LOST : BUS_MALFORMED;
    case BUS_ERROR:
        return size != HEAD + 7 ? BUS_MALFORMED : bytes[IS_SENDER] == 1 ? BUS_FRAME_LOST : BUS_NOTICE;
    case CONFIRM:
        return size == HEAD + 4 ? BUS_NOTICE : BUS_MALFORMED;
    case CONFIGURATION:
        return size > HEAD ? BUS_NOTICE : BUS_MALFORMED;
    case STATUS:
        return size == HEAD + 1 ? BUS_NOTICE : BUS_MALFORMED;
    case WAKEUP:
        return size == HEAD ? BUS_NOTICE : BUS_MALFORMED;
    default:
        return BUS_MALFORMED;
    }
}

bool bus_operations_next(BusOperations *from, BusOperation *operation) {
    if (from->left == 0)
        return false;
    const size_t told = from->left < HEAD ? 0 : read_number(from->at + 4, 4);
    const bool fits = told >= HEAD && told <= from->left;
    *operation = (BusOperation){.kind = BUS_MALFORMED, .bytes = from->at, .size = fits ? told : from->left};
    if (fits)
        operation->kind = kind_of(operation);
    from->at += operation->size;
    from->left -= operation->size;
    return true;
}

size_t bus_write_frame(const CanFrame *frame, uint8_t *to, size_t room) {
    const size_t size = TRANSMIT_HEAD + (size_t)frame->length;
    if (room < size)
        return 0;
    write_head(to, CAN_TRANSMIT, size);
    write_number(to + AT_ID, frame->id, 4);
    to[AT_EXTENDED] = frame->extended;
    to[AT_REMOTE] = frame->remote;
    write_number(to + AT_LENGTH, frame->length, 2);
    memcpy(to + TRANSMIT_HEAD, frame->data, frame->length);
    return size;
}

size_t bus_write_format_error(const BusOperation *wrong, uint8_t *to, size_t room) {
    const size_t quoted = wrong->size < QUOTED_MAX ? wrong->size : QUOTED_MAX;
    if (room < FORMAT_ERROR_HEAD + quoted)
        return 0;
    write_head(to, FORMAT_ERROR, FORMAT_ERROR_HEAD + quoted);
    write_number(to + HEAD, (uint32_t)quoted, 2);
    memcpy(to + FORMAT_ERROR_HEAD, wrong->bytes, quoted);
    return FORMAT_ERROR_HEAD + quoted;
}

size_t bus_write_configuration(uint32_t bit_rate, uint8_t *to) {
    write_head(to, CONFIGURATION, BIT_RATE_SIZE);
    to[HEAD] = CAN_BAUDRATE;
    write_number(to + HEAD + 1, bit_rate, 4);
    to += BIT_RATE_SIZE;
    write_head(to, CONFIGURATION, BEHAVIOR_SIZE);
    to[HEAD] = ARBITRATION_LOST_BEHAVIOR;
    to[HEAD + 1] = BUFFER_AND_RETRANSMIT;
    return BIT_RATE_SIZE + BEHAVIOR_SIZE;
}
