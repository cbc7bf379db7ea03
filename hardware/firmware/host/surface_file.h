/* The surface of the emulated printer as a file that outlives the process: "INKSURF1", cells nx and ny and the number
 * of scans as 32-bit numbers, then the heights [m] in C order; numbers as the machine writes them. */
#ifndef INKLOOP_SURFACE_FILE_H
#define INKLOOP_SURFACE_FILE_H

#include "world.h"

enum { SURFACE_PATH_ROOM = 4096 }; /* bytes of the longest path with its terminating 0 */

/* Replaces the file as a whole; nothing for the path "". False: it could not be written. */
bool surface_file_write(const World *world, const char *path);

/* Resumes with the surface of the file, if there is one. NULL, or the error message. */
const char *surface_file_read(World *world, const char *path);

#endif
