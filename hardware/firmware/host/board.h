/* The HAL of an emulated node: storage in memory and, if there is one, in a file; actuators and inputs in the world.
 * Work is finished only when the resulting surface has been written to its file. */
#ifndef INKLOOP_BOARD_H
#define INKLOOP_BOARD_H

#include <stdio.h>

#include "world.h"

enum { BOARD_SECTORS = 4, BOARD_SECTOR_BYTES = 4096, BOARD_STORAGE_BYTES = BOARD_SECTORS * BOARD_SECTOR_BYTES };
enum { BOARD_WRITE_UNIT = 8 /* bytes of a flash word */, BOARD_WORDS = BOARD_STORAGE_BYTES / BOARD_WRITE_UNIT };

typedef struct {
    World *world;
    const char *surface_path; /* "": the surface is not kept */
    uint8_t storage[BOARD_STORAGE_BYTES];
    bool unreadable[BOARD_WORDS]; /* until their sector is erased */
    uint32_t write_unit;
    uint32_t writes; /* records written or tried */
    FILE *file;      /* NULL: memory only */
    int32_t torn_at; /* >= 0: the next write ends after so many bytes, as in a power failure */
    Work work;
    bool working;
    uint32_t work_began;
    bool watched; /* the watchdog is armed */
    uint32_t kicked_at;
    bool by_watchdog; /* cause of the next power-up */
} Board;

/* Erased storage in memory; `world` and `surface_path` are kept. */
void board_init(Board *board, World *world, const char *surface_path);

/* The functions above `board`. */
Hal board_hal(Board *board);

/* Reads the storage from a file; false: it could not be read or made. */
bool board_open_file(Board *board, const char *path);

#endif
