#include "requests.h"

#include <string.h>

#include "bytes.h"
#include "services.h"
#include "uds.h"

enum { ROUTINES = 9, IDENTIFIERS = 8, CELL_BYTES_MAX = 12 };

static size_t head_of(uint8_t *to, uint8_t service, uint8_t coding, uint8_t layer, uint32_t size) {
    to[0] = service;
    to[1] = coding;
    to[2] = 0x44;
    put_u32(to + 3, layer);
    put_u32(to + 7, size);
    return 11;
}

size_t fuzz_request_clear(uint8_t *to) {
    memset(to, 0, 13);
    to[0] = UDS_ROUTINE_CONTROL;
    to[1] = UDS_START;
    put_u16(to + 2, ROUTINE_CLEAR);
    to[12] = 1;
    return 13;
}

size_t fuzz_request_routine(Input *input, uint8_t *to) {
    const uint8_t what = input_byte(input);
    const uint16_t routine = (uint16_t)(ROUTINE_CLEAR + what % ROUTINES);
    to[0] = UDS_ROUTINE_CONTROL;
    to[1] = what >= 0xF0 ? UDS_RESULTS : UDS_START;
    put_u16(to + 2, routine);
    const uint8_t which = input_byte(input);
    put_u32(to + 4, 1u + (which >> 7));
    put_u16(to + 8, which & 7);
    to[10] = input_byte(input);
    to[11] = which >> 3 & 3;
    if (to[1] == UDS_RESULTS || routine == ROUTINE_HOME || routine == ROUTINE_PURGE || routine == ROUTINE_SCAN)
        return 12;
    const uint8_t option = input_byte(input);
    if (routine == ROUTINE_CURE) {
        put_u16(to + 12, option == 0xFF ? UINT16_MAX : option);
        return 14;
    }
    to[12] = option;
    return 13;
}

size_t fuzz_pattern(Input *input, uint8_t *to) {
    const uint8_t form = input_byte(input), shape = input_byte(input);
    to[0] = 1;
    to[1] = form & 1 ? 2 : form & 2 ? 3 : 1;
    put_u16(to + 2, shape & 7);
    put_u16(to + 4, shape >> 3 & 7);
    to[6] = form & 4 ? 1 : form & 8 ? 2 : 4;
    to[7] = 0;
    const size_t cells = (form >> 4) % (CELL_BYTES_MAX + 1);
    input_fill(input, to + 8, cells);
    return 8 + cells;
}

size_t fuzz_request_download(uint8_t layer, bool run_length, uint32_t size, uint8_t *to) {
    return head_of(to, UDS_DOWNLOAD, run_length ? 0x10 : 0, layer, size);
}

size_t fuzz_request_upload(uint8_t layer, uint32_t size, uint8_t *to) {
    return head_of(to, UDS_UPLOAD, 0, layer, size);
}

size_t fuzz_request_read(Input *input, uint8_t *to) {
    static const uint16_t KNOWN[IDENTIFIERS] = {ID_VERSION, ID_STATE,    ID_TIMES,   ID_LIMITS,
                                                ID_MAP,     ID_TRANSFER, ID_JOURNAL, 0x1234};
    to[0] = UDS_READ;
    put_u16(to + 1, KNOWN[input_byte(input) % IDENTIFIERS]);
    return 3;
}

size_t fuzz_request_raw(Input *input, uint8_t *to) {
    const size_t length = input_byte(input);
    input_fill(input, to, length);
    return length;
}
