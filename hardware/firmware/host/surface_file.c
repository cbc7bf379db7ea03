#include "surface_file.h"

#include <stdio.h>
#include <string.h>

static const char MAGIC[8] = {'I', 'N', 'K', 'S', 'U', 'R', 'F', '1'}; /* without a terminating zero */

static size_t height_bytes(const World *world) {
    return (size_t)world->options.nx * world->options.ny * sizeof(double);
}

bool surface_file_write(const World *world, const char *path) {
    if (path[0] == '\0')
        return true;
    char temporary[SURFACE_PATH_ROOM + 4];
    snprintf(temporary, sizeof temporary, "%s.new", path);
    remove(temporary); /* of a killed process, or a link, which is not followed */
    FILE *file = fopen(temporary, "wbx");
    if (!file)
        return false;
    const int32_t head[3] = {world->options.nx, world->options.ny, world->scans};
    const bool written = fwrite(MAGIC, 1, sizeof MAGIC, file) == sizeof MAGIC &&
                         fwrite(head, 1, sizeof head, file) == sizeof head &&
                         fwrite(world->height, 1, height_bytes(world), file) == height_bytes(world);
    if (fclose(file) != 0 || !written) {
        remove(temporary);
        return false;
    }
#ifdef _WIN32
    remove(path); /* on some systems rename does not replace an existing file */
#endif
    return rename(temporary, path) == 0;
}

const char *surface_file_read(World *world, const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file)
        return NULL;
    char magic[sizeof MAGIC];
    int32_t head[3] = {0};
    const bool known = fread(magic, 1, sizeof magic, file) == sizeof magic && memcmp(magic, MAGIC, sizeof magic) == 0 &&
                       fread(head, 1, sizeof head, file) == sizeof head;
    const bool fits = known && head[0] == world->options.nx && head[1] == world->options.ny;
    const bool whole = fits && fread(world->height, 1, height_bytes(world), file) == height_bytes(world);
    fclose(file);
    world->scans = head[2];
    if (!known)
        return "surface.bin is not a surface of the emulator; choose another folder or remove it";
    if (!fits)
        return "surface.bin has another number of cells than nx and ny; choose another folder or remove it";
    return whole ? NULL : "surface.bin is cut off; remove it and the journals to start again";
}
