/* ISO-TP (ISO 15765-2) on classic CAN with normal addressing: messages of 1 to 4095 bytes in frames of 8.
 *
 * One object is one end of one pair of ids and moves one message each way at a time; both ways may be busy at once. It
 * knows no bus and no clock: frames and the time in ms (which may wrap) come in, frames go out when asked for. In each
 * turn of its loop the caller
 *
 *     isotp_take(&end, &frame, now)           for each frame received
 *     isotp_tick(&end, now)                   to let timeouts pass
 *     while (room and isotp_next(&end, now, &frame)) send(frame)
 *     isotp_received(&end, &length)           and, when it is done with the bytes, isotp_release(&end)
 *
 * ISO-TP detects a lost frame, but neither an altered byte nor 16 lost ones in a row: bulk data carries its own
 * checksum. */
#ifndef INKLOOP_ISOTP_H
#define INKLOOP_ISOTP_H

#include <stddef.h>

#include "can_frame.h"

enum { ISOTP_LENGTH_MAX = 4095 };

typedef struct {
    uint32_t receive_id, send_id; /* 11-bit ids */
    uint8_t block_size;           /* frames that the sender may send before the next flow control; 0: all */
    uint8_t separation;           /* STmin requested, as on the wire: 0-127 ms, 0xF1-0xF9 100-900 us */
    uint8_t padding;              /* byte that fills sent frames to 8 */
    uint8_t wait_max;             /* "wait" flow controls accepted in a row */
    uint16_t flow_timeout;        /* timeout of a flow control in ms (N_Bs; ISO 15765-2: 1000) */
    uint16_t frame_timeout;       /* timeout of a consecutive frame in ms (N_Cr; ISO 15765-2: 1000) */
} IsotpOptions;

/* Result of the last message of each way. */
typedef enum {
    ISOTP_NONE,     /* no message yet, or one is under way */
    ISOTP_DONE,     /* received whole; the last frame was handed out */
    ISOTP_TIMEOUT,  /* the other side stopped */
    ISOTP_SEQUENCE, /* received: a wrong sequence number */
    /* received: longer than ISOTP_LENGTH_MAX, or the last message is not released; sent: refused by the other side as
     * too long */
    ISOTP_OVERFLOW,
    ISOTP_WAITS, /* sent: more than `wait_max` waits */
    ISOTP_FLOW,  /* sent: a flow status that the standard does not know */
} IsotpEnd;

typedef enum { ISOTP_SEND_IDLE, ISOTP_SEND_START, ISOTP_SEND_FLOW, ISOTP_SEND_FRAMES } IsotpSending;
typedef enum { ISOTP_RECEIVE_IDLE, ISOTP_RECEIVE_FRAMES, ISOTP_RECEIVE_HELD } IsotpReceiving;
typedef enum { ISOTP_FLOW_GO, ISOTP_FLOW_WAIT, ISOTP_FLOW_OVERFLOW, ISOTP_FLOW_NONE } IsotpFlow;

typedef struct {
    IsotpOptions options;
    struct {
        IsotpSending state;
        IsotpEnd end;
        uint16_t length, position;
        uint8_t sequence, separation_ms, waits;
        uint8_t block, block_size; /* frames left in this block; 0 in `block_size`: no blocks */
        uint32_t since;            /* ms, when the present wait began */
        bool spaced;               /* the next frame keeps its distance from `since` */
        uint8_t bytes[ISOTP_LENGTH_MAX];
    } sending;
    struct {
        IsotpReceiving state;
        IsotpEnd end;
        IsotpFlow flow; /* flow control to be sent */
        uint16_t length, position;
        uint8_t sequence, block;
        uint32_t since;
        uint8_t bytes[ISOTP_LENGTH_MAX];
    } receiving;
    struct {
        uint32_t received, sent, dropped, replaced; /* counts of messages; replaced: a new one began before the end */
        uint32_t malformed, unexpected;             /* counts of frames */
    } count;
} Isotp;

void isotp_init(Isotp *end, const IsotpOptions *options);

/* Takes a frame from the bus; other ids are ignored. Returns whether the id matched. */
bool isotp_take(Isotp *end, const CanFrame *frame, uint32_t now);

/* Ends a message that has waited too long. */
void isotp_tick(Isotp *end, uint32_t now);

/* The next frame that is due, if any. A frame handed out counts as sent: call only with room for it. */
bool isotp_next(Isotp *end, uint32_t now, CanFrame *frame);

/* Begins to send a copy of `bytes`; false while a message is under way or for an impossible length. */
bool isotp_send(Isotp *end, const uint8_t *bytes, size_t length);
bool isotp_is_sending(const Isotp *end);

/* The message received last, NULL if there is none; it is kept, and no other is received, until it is released. */
const uint8_t *isotp_received(const Isotp *end, size_t *length);
void isotp_release(Isotp *end);

/* Drops the messages under way in both directions. */
void isotp_abort(Isotp *end);

#endif
