#include "uds.h"

#include "bytes.h"

Key uds_key(const uint8_t *bytes) {
    return (Key){.job = get_u32(bytes), .layer = get_u16(bytes + 4), .pass = bytes[6], .attempt = bytes[7]};
}

size_t uds_refusal(uint8_t *answer, uint8_t service, uint8_t code) {
    answer[0] = UDS_NEGATIVE;
    answer[1] = service;
    answer[2] = code;
    return 3;
}

size_t uds_routine_answer(uint8_t *answer, uint8_t kind, uint16_t routine, Outcome outcome, const Key *key) {
    answer[0] = UDS_ROUTINE_CONTROL + UDS_POSITIVE;
    answer[1] = kind;
    put_u16(answer + 2, routine);
    answer[4] = (uint8_t)outcome;
    put_u32(answer + 5, key->job);
    put_u16(answer + 9, key->layer);
    answer[11] = key->pass;
    answer[12] = key->attempt;
    return 5 + KEY_BYTES;
}
