/* Board functions that a node needs. Every call returns at once, and the node polls again at its next tick; only
 * storage_erase may take longer.
 *
 * The core never sends a frame and never reads a clock: its caller does, and passes bytes and milliseconds in. It calls
 * these functions from the functions of node.h only, one at a time. Before node_init the supply is good, so that
 * storage, inputs and outputs work: hold the processor in reset below the voltage that they need (brown-out). */
#ifndef INKLOOP_HAL_H
#define INKLOOP_HAL_H

#include <stdbool.h>
#include <stdint.h>

#include "pattern.h"

/* Wired inputs of every node: the cure lamp and the head must see each other's state without the bus. */
enum {
    LINE_GATE_CLOSED = 1, /* end switch: the gate between lamp and nozzles is closed */
    LINE_GATE_OPEN = 2,   /* end switch: the gate is open; neither: it is moving, or broken */
    LINE_LAMP_ON = 4,     /* current of the cure lamp */
    LINE_READY = 8,       /* ink temperature and back pressure are in their ranges */
    LINE_HOMED = 16       /* the stage has been homed */
};

typedef enum { WORK_HOME, WORK_MOVE, WORK_PURGE, WORK_JET, WORK_SCAN } WorkKind;
typedef enum {
    WORK_RUNNING,
    WORK_FINISHED,
    WORK_FAILED,
    WORK_NOT_STORED /* ended, but its result cannot be stored */
} WorkProgress;

typedef struct {
    WorkKind kind;
    bool dry;               /* move without jetting */
    uint8_t colour;         /* WORK_JET: jet the cells of this colour (fmus/deposition/pass_colour.h), 255: all */
    uint8_t station;        /* WORK_MOVE: 0 home, 1 print, 2 cure, 3 scan */
    uint16_t layer;         /* counted from 1 */
    const Pattern *pattern; /* WORK_JET */
} Work;

typedef struct {
    uint16_t nx, ny, lsb_nm; /* cells; value of one step of a reading [nm] */
    int32_t datum;           /* steps added to every reading */
} MapShape;

typedef struct {
    void *context; /* first argument of all these functions */

    /* Non-volatile memory: `sectors`, at least two, of `sector_bytes`, 0xFF where erased. The node writes whole aligned
     * words of `write_unit` bytes, each once after an erasure: 8, 16 or 32 for flash, a power of two; 0 or 1 for single
     * bytes. A node on any other memory stays in FAULT. */
    uint32_t sectors, sector_bytes, write_unit;

    /* False: bytes that cannot be read, also a word that its ECC rejects. At power-up such a journal is no empty one: a
     * person is asked. */
    bool (*storage_read)(void *context, uint32_t offset, uint8_t *to, uint32_t length);

    /* False: not written; the node skips the place. A power failure may tear a write. */
    bool (*storage_write)(void *context, uint32_t offset, const uint8_t *from, uint32_t length);

    /* May take 300 ms, less one turn of the caller's loop: less than limits.alive and the watchdog's period. Lamp and
     * jets are off meanwhile, the gate is driven closed, and the node hears and says nothing; what arrives waits in the
     * queue of node_frames.h. From 200 ms on a master may take the node for lost (bench.silence_s). */
    bool (*storage_erase)(void *context, uint32_t sector);

    void (*set_lamp)(void *context, bool on);
    void (*set_gate)(void *context, bool open);
    uint32_t (*lines)(void *context); /* LINE_... that are true now */

    /* Restarts the hardware watchdog. The first kick arms it; without a kick for one period, at most limits.alive, the
     * hardware itself switches lamp, gate and motion off and resets the node. */
    void (*kick)(void *context);

    bool (*begin)(void *context, const Work *work); /* false: it cannot begin */
    WorkProgress (*progress)(void *context);        /* progress of the work begun last */
    void (*halt)(void *context);                    /* stops jetting, holds the stage, abandons the work */

    MapShape (*map_shape)(void *context);                                /* shape of the last finished scan */
    bool (*map_reading)(void *context, uint32_t cell, int16_t *reading); /* false: no valid reading */
} Hal;

#endif
