/* The line protocol of serial CAN adapters (LAWICEL, "slcan"), adapter side, classic frames.
 *
 *     tIIILDD..  TIIIIIIIILDD..  rIIIL  RIIIIIIIIL   a frame: id, length, data in hexadecimal; lines end with CR
 *     Sn  sXXXX                                      bit rate, while closed
 *     O  L  C                                        open, open for listening, close
 *     V  N  F  Zn                                    version, serial number, status, time stamps (only off)
 *
 * Answers: CR, "z" CR or "Z" CR after a frame, a text with CR, or BEL for a line that is malformed or cannot be
 * executed now. A malformed line is counted and dropped. */
#ifndef INKLOOP_SLCAN_H
#define INKLOOP_SLCAN_H

#include <stddef.h>

#include "can_frame.h"

enum {
    SLCAN_LINE_MAX = 32,   /* the longest line of a classic frame is 27 characters with its CR */
    SLCAN_ANSWER_MAX = 8,  /* the longest answer is "V" and four digits with CR */
    SLCAN_BIT_RATE_MAX = 8 /* S0 10, 20, 50, 100, 125, 250, 500, 800, S8 1000 kbit/s */
};

typedef struct {
    char line[SLCAN_LINE_MAX];
    uint8_t used;
    bool overlong; /* the present line did not fit; it is dropped at its CR */
    bool open, listen_only;
    uint32_t frames, malformed, refused;
} Slcan;

typedef struct {
    bool has_frame; /* `frame` came from the other side, to be put on the bus */
    CanFrame frame;
    uint8_t answer_length;
    char answer[SLCAN_ANSWER_MAX]; /* answer to the host, without a terminating 0 */
} SlcanEvent;

void slcan_init(Slcan *slcan);

/* Takes one byte, mostly without a result. Returns whether `event` has one. */
bool slcan_take(Slcan *slcan, uint8_t byte, SlcanEvent *event);

/* Writes the line of a frame, with its CR and without a terminating 0; returns its length, or 0 for an invalid
 * frame. */
size_t slcan_write(const CanFrame *frame, char line[SLCAN_LINE_MAX]);

#endif
