/* Operations of a CAN bus as FMI-LS-BUS (Network Abstraction, CAN 1.0.0) writes them into binaries, one after the
 * other: code and total length, 32 bits each, then the arguments; numbers are little-endian. */
#ifndef INKLOOP_BUS_OPERATIONS_H
#define INKLOOP_BUS_OPERATIONS_H

#include <stddef.h>

#include "can_frame.h"

typedef enum {
    BUS_FRAME,      /* CAN Transmit */
    BUS_FRAME_LOST, /* Arbitration Lost, Bus Error: a frame of this node did not arrive */
    BUS_NOT_READ,   /* Format Error: a partner could not read an operation of this node */
    BUS_NOTICE,     /* Confirm, Configuration, Status, Wakeup: nothing that a node acts upon */
    BUS_MALFORMED   /* no operation, or one that a node of classic CAN does not know */
} BusOperationKind;

typedef struct {
    BusOperationKind kind;
    CanFrame frame; /* of BUS_FRAME */
    const uint8_t *bytes;
    size_t size;
} BusOperation;

typedef struct {
    const uint8_t *at;
    size_t left;
} BusOperations;

/* The next operation; false at the end. One whose length cannot be ends the binary: all that is left is malformed. */
bool bus_operations_next(BusOperations *from, BusOperation *operation);

/* These write an operation and return its size, 0 if there is not so much room. */
size_t bus_write_frame(const CanFrame *frame, uint8_t *to, size_t room);

/* Format Error about an operation, of which it repeats up to 65525 bytes. */
size_t bus_write_format_error(const BusOperation *wrong, uint8_t *to, size_t room);

/* Configuration: the bit rate, and that frames which lose arbitration are sent again; needs 23 bytes. */
size_t bus_write_configuration(uint32_t bit_rate, uint8_t *to);

#endif
