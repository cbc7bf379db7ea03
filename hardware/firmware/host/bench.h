/* The emulator: the four nodes of the bench on one world, and the HAL that joins them.
 *
 * All memory is one block of bench_size bytes. With a folder, journals and surface are files there that outlive the
 * process: journal-head.bin, journal-stage.bin, journal-cure.bin, journal-profiler.bin, surface.bin. */
#ifndef INKLOOP_BENCH_H
#define INKLOOP_BENCH_H

#include "board.h"
#include "node.h"
#include "surface_file.h"
#include "world.h"

enum { BENCH_HEAD, BENCH_STAGE, BENCH_CURE, BENCH_PROFILER, BENCH_NODES };

typedef struct {
    WorldOptions world;
    NodeLimits limits;
    bool one_node; /* the first node has all four roles, and the others stay off */
} BenchOptions;

typedef struct {
    BenchOptions options;
    World world;
    Board board[BENCH_NODES];
    Hal hal[BENCH_NODES];
    Node node[BENCH_NODES];
    uint32_t pattern_bytes;               /* of the memory of the head */
    char surface_path[SURFACE_PATH_ROOM]; /* "": the surface is not kept */
} Bench;

BenchOptions bench_defaults(void);

/* Sets an option by its name, as variables.toml of the FMUs has it, SI; also pass_ms, scan_ms, home_ms, move_ms,
 * purge_ms, gate_ms, alive_ms, watchdog_ms, one_node, lamp_limit_ms. False: no such name, or not a value for it. */
bool bench_set(BenchOptions *options, const char *name, double value);

/* Why there can be no such bench, NULL if there can. */
const char *bench_fault(const BenchOptions *options);

/* Bytes of a bench with its grids and the memory of its head. */
size_t bench_size(const BenchOptions *options);

/* A bench without files in `memory` of that size, zeroed and aligned for doubles. */
Bench *bench_init(void *memory, const BenchOptions *options);

/* Sets every pointer of a bench that stands in its memory; unlinked, it has none: its bytes may be kept or moved. */
void bench_link(Bench *bench);
void bench_unlink(Bench *bench);

/* NULL: no memory, or a file in `folder` could not be made or belongs to another grid; `why` holds the message. */
Bench *bench_create(const BenchOptions *options, const char *folder, char *why, size_t room);
void bench_delete(Bench *bench);

/* Power-up of a node; a step under way ends as in a power failure. */
void bench_power_up(Bench *bench, int node, uint32_t now);

/* Without power the lamp is dark, a spring closes the gate, and nothing moves. The journal stays as it is. */
void bench_power_off(Bench *bench, int node);

/* The newest `count` records of a node cannot be read any more, until their sector is erased. */
void bench_decay(Bench *bench, int node, uint32_t count);

/* Whether the watchdog has expired: no kick for its period. It has then switched the node off at the end of that
 * period, however late this is called; the node needs a power-up, which knows the cause. */
bool bench_watchdog_bites(Bench *bench, int node, uint32_t now);

/* Whether every node has kicked its watchdog in the present turn; only then a board with one watchdog for all kicks
 * it. */
bool bench_is_well(const Bench *bench);

int bench_node_count(const Bench *bench);

#endif
