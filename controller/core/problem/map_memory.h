/* Memory for maps of a grid.
 *
 * Large grids get large pages where the system has them: a map is written once or twice, and to get its memory in pages
 * of 4 KiB takes longer than that. */
#ifndef INKLOOP_MAP_MEMORY_H
#define INKLOOP_MAP_MEMORY_H

#include <stddef.h>

/* count * size bytes, all 0; NULL if there is no memory. */
void *take_maps(size_t count, size_t size);

/* The same, uninitialised. */
void *take_raw_maps(size_t count, size_t size);

/* Releases memory of these functions; NULL is allowed. */
void give_maps(void *memory);

#endif
