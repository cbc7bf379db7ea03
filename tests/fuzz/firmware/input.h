/* The bytes of a fuzzer as a sequence of choices; zeros when there are no more. */
#ifndef INKLOOP_FUZZ_INPUT_H
#define INKLOOP_FUZZ_INPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct {
    const uint8_t *bytes;
    size_t left;
} Input;

static inline uint8_t input_byte(Input *input) {
    if (input->left == 0)
        return 0;
    input->left--;
    return *input->bytes++;
}

static inline uint16_t input_word(Input *input) {
    const unsigned high = input_byte(input);
    return (uint16_t)(high << 8 | input_byte(input));
}

static inline void input_fill(Input *input, uint8_t *to, size_t length) {
    for (size_t k = 0; k < length; k++)
        to[k] = input_byte(input);
}

/* Ends the run when an invariant of the firmware is violated: fuzzers keep that input. */
static inline void invariant(bool holds, const char *message) {
    if (holds)
        return;
    fprintf(stderr, "violated invariant: %s\n", message);
    abort();
}

/* Entry point of every target: one run over one input. */
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t length);

#endif
