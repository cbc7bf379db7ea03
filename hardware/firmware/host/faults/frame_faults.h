/* What becomes of a frame that is hit. */
#ifndef INKLOOP_FRAME_FAULTS_H
#define INKLOOP_FRAME_FAULTS_H

#include "fault.h"
#include "slcan.h"

/* Another bit in one byte of its data: that of the fault, or any. */
void frame_corrupt(CanFrame *frame, const Fault *fault);

/* The counter of the frame before, with a check byte that is right. */
void frame_hold_counter(CanFrame *frame, uint8_t counter);

/* A check byte that is wrong. */
void frame_spoil_check(CanFrame *frame);

/* Its line as no adapter may write it; the length. */
size_t frame_garble(const CanFrame *frame, const Fault *fault, char line[2 * SLCAN_LINE_MAX]);

#endif
