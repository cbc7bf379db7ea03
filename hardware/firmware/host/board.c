#include "board.h"

#include <string.h>

#include "surface_file.h"

static bool write_through(Board *board, uint32_t offset, uint32_t length) {
    if (!board->file)
        return true;
    return fseek(board->file, (long)offset, SEEK_SET) == 0 &&
           fwrite(board->storage + offset, 1, length, board->file) == length && fflush(board->file) == 0;
}

static bool storage_read(void *context, uint32_t offset, uint8_t *to, uint32_t length) {
    const Board *board = context;
    if (offset > BOARD_STORAGE_BYTES || length > BOARD_STORAGE_BYTES - offset)
        return false;
    for (uint32_t word = offset / BOARD_WRITE_UNIT; word * BOARD_WRITE_UNIT < offset + length; word++)
        if (board->unreadable[word])
            return false;
    memcpy(to, board->storage + offset, length);
    return true;
}

/* As flash with an ECC takes them: whole words, each once after an erasure. */
static bool is_writable(const Board *board, uint32_t offset, uint32_t length) {
    if (offset > BOARD_STORAGE_BYTES || length > BOARD_STORAGE_BYTES - offset || offset % board->write_unit != 0 ||
        length % board->write_unit != 0)
        return false;
    for (uint32_t k = offset; k < offset + length; k++)
        if (board->storage[k] != 0xFF)
            return false;
    return true;
}

static bool storage_write(void *context, uint32_t offset, const uint8_t *from, uint32_t length) {
    Board *board = context;
    board->writes++;
    if (!is_writable(board, offset, length))
        return false;
    const bool torn = board->torn_at >= 0 && (uint32_t)board->torn_at < length;
    const uint32_t written = torn ? (uint32_t)board->torn_at : length;
    memcpy(board->storage + offset, from, written);
    return write_through(board, offset, written) && !torn;
}

static bool storage_erase(void *context, uint32_t sector) {
    Board *board = context;
    if (sector >= BOARD_SECTORS)
        return false;
    memset(board->storage + sector * BOARD_SECTOR_BYTES, 0xFF, BOARD_SECTOR_BYTES);
    memset(board->unreadable + sector * (BOARD_WORDS / BOARD_SECTORS), 0, BOARD_WORDS / BOARD_SECTORS);
    return write_through(board, sector * BOARD_SECTOR_BYTES, BOARD_SECTOR_BYTES);
}

static World *world_of(void *context) {
    return ((Board *)context)->world;
}

static void set_lamp(void *context, bool on) {
    world_set_lamp(world_of(context), on);
}

static void set_gate(void *context, bool open) {
    world_set_gate(world_of(context), open);
}

static void kick(void *context) {
    Board *board = context;
    board->watched = board->world->options.watchdog_ms > 0;
    board->kicked_at = board->world->now;
}

static uint32_t lines(void *context) {
    return world_lines(world_of(context));
}

static uint32_t duration_of(const World *world, WorkKind kind) {
    const WorldOptions *options = &world->options;
    switch (kind) {
    case WORK_HOME:
        return options->home_ms;
    case WORK_MOVE:
        return options->move_ms;
    case WORK_PURGE:
        return options->purge_ms;
    case WORK_JET:
        return options->pass_ms;
    default:
        return options->scan_ms;
    }
}

static bool begin(void *context, const Work *work) {
    Board *board = context;
    const World *world = world_of(context);
    const Pattern *pattern = work->pattern;
    if (board->working ||
        (work->kind == WORK_JET && (pattern->nx != world->options.nx || pattern->ny != world->options.ny)))
        return false;
    board->work = *work;
    board->working = true;
    board->work_began = world->now;
    return true;
}

/* Ends the work: all of it is done, or the share that fitted into the time. */
static bool finish(Board *board, double share) {
    World *world = board->world;
    board->working = false;
    if (board->work.kind == WORK_JET && !board->work.dry)
        world_jet(world, &board->work, share);
    if (board->work.kind == WORK_HOME && share >= 1.0)
        world->homed = true;
    if (board->work.kind == WORK_SCAN && share >= 1.0)
        world_scan(world);
    return !(world->broken & BROKEN_STORAGE_FULL) && surface_file_write(world, board->surface_path);
}

static WorkProgress progress(void *context) {
    Board *board = context;
    const World *world = world_of(context);
    if (!board->working || world->broken & BROKEN_WORK_FAILS)
        return WORK_FAILED;
    if (world->broken & BROKEN_WORK_HANGS || world->now - board->work_began < duration_of(world, board->work.kind))
        return WORK_RUNNING;
    return finish(board, 1.0) ? WORK_FINISHED : WORK_NOT_STORED;
}

static void halt(void *context) {
    Board *board = context;
    const World *world = world_of(context);
    if (!board->working)
        return;
    const double whole = duration_of(world, board->work.kind);
    const double elapsed = world->now - board->work_began;
    finish(board, elapsed < whole ? elapsed / whole : 0.999);
}

static MapShape map_shape(void *context) {
    return world_map_shape(world_of(context));
}

static bool map_reading(void *context, uint32_t cell, int16_t *reading) {
    return world_map_reading(world_of(context), cell, reading);
}

void board_init(Board *board, World *world, const char *surface_path) {
    memset(board, 0, sizeof *board);
    board->world = world;
    board->surface_path = surface_path;
    board->torn_at = -1;
    board->write_unit = BOARD_WRITE_UNIT;
    memset(board->storage, 0xFF, sizeof board->storage);
}

Hal board_hal(Board *board) {
    return (Hal){.context = board,
                 .sectors = BOARD_SECTORS,
                 .sector_bytes = BOARD_SECTOR_BYTES,
                 .write_unit = board->write_unit,
                 .storage_read = storage_read,
                 .storage_write = storage_write,
                 .storage_erase = storage_erase,
                 .set_lamp = set_lamp,
                 .set_gate = set_gate,
                 .lines = lines,
                 .kick = kick,
                 .begin = begin,
                 .progress = progress,
                 .halt = halt,
                 .map_shape = map_shape,
                 .map_reading = map_reading};
}

bool board_open_file(Board *board, const char *path) {
    board->file = fopen(path, "r+b");
    if (!board->file)
        board->file = fopen(path, "w+b");
    if (!board->file)
        return false;
    if (fread(board->storage, 1, BOARD_STORAGE_BYTES, board->file) == BOARD_STORAGE_BYTES)
        return true;
    memset(board->storage, 0xFF, BOARD_STORAGE_BYTES); /* new, or its first writing was interrupted */
    return write_through(board, 0, BOARD_STORAGE_BYTES);
}
