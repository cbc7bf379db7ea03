/* A classic CAN frame. */
#ifndef INKLOOP_CAN_FRAME_H
#define INKLOOP_CAN_FRAME_H

#include <stdbool.h>
#include <stdint.h>

enum { CAN_DATA_MAX = 8, CAN_ID_MAX = 0x7FF, CAN_EXTENDED_ID_MAX = 0x1FFFFFFF };

typedef struct {
    uint32_t id;
    bool extended; /* 29-bit id */
    bool remote;   /* remote frame: requests data and carries none */
    uint8_t length;
    uint8_t data[CAN_DATA_MAX];
} CanFrame;

#endif
