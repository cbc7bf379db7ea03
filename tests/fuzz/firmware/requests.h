/* Requests as a master would put them together, with numbers from the input: small ones, so that they meet. */
#ifndef INKLOOP_FUZZ_REQUESTS_H
#define INKLOOP_FUZZ_REQUESTS_H

#include "input.h"

enum { FUZZ_REQUEST_MAX = 600 };

/* The routine that brings a node to work: 31 01 clear, confirmed by a person. */
size_t fuzz_request_clear(uint8_t *to);

/* A routine: number, kind, job, layer, pass, attempt, option from the input. */
size_t fuzz_request_routine(Input *input, uint8_t *to);

/* The bytes of a pattern as pattern.h has it, small enough or not. */
size_t fuzz_pattern(Input *input, uint8_t *to);

/* 34 of a layer; `size` bytes are announced. */
size_t fuzz_request_download(uint8_t layer, bool run_length, uint32_t size, uint8_t *to);

/* 35 of a layer. */
size_t fuzz_request_upload(uint8_t layer, uint32_t size, uint8_t *to);

/* 22 of one of the identifiers. */
size_t fuzz_request_read(Input *input, uint8_t *to);

/* Any bytes. */
size_t fuzz_request_raw(Input *input, uint8_t *to);

#endif
