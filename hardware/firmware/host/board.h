/* The HAL of an emulated node: storage in memory and, if there is one, in a file; actuators and inputs in the world. */
#ifndef INKLOOP_BOARD_H
#define INKLOOP_BOARD_H

#include "bench.h"

/* The functions above `board`. */
Hal board_hal(Board *board);

/* Reads what a file holds of the storage; false: it could not be read or made. */
bool board_open_file(Board *board, const char *path);

#endif
