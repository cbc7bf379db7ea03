/* The effects of faults on a frame. */
#ifndef INKLOOP_FRAME_FAULTS_H
#define INKLOOP_FRAME_FAULTS_H

#include "fault.h"
#include "slcan.h"

/* Flips a bit in one byte of the data: that of the fault, or any. */
void frame_corrupt(CanFrame *frame, const Fault *fault);

/* Repeats the counter of the frame before, with a correct check byte. */
void frame_hold_counter(CanFrame *frame, uint8_t counter);

/* Makes the check byte wrong. */
void frame_spoil_check(CanFrame *frame);

/* Writes a malformed slcan line of the frame; returns its length. */
size_t frame_garble(const CanFrame *frame, const Fault *fault, char line[2 * SLCAN_LINE_MAX]);

#endif
