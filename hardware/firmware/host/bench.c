#include "bench.h"

#include "emulated_parameters.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

typedef enum { REAL, COUNT16, COUNT32, SIGNED32, KIND, FLAG } Type;

typedef struct {
    const char *name;
    Type type;
    size_t at;
    double min, max;
} Option;

#define WORLD(member) offsetof(BenchOptions, world.member)
static const Option OPTIONS[] = {
    EMULATED_PARAMETERS, /* generated from variables.toml of the FMUs */
    {"nx", COUNT16, WORLD(nx), 1, UINT16_MAX},
    {"ny", COUNT16, WORLD(ny), 1, UINT16_MAX},
    {"printer_seed", SIGNED32, WORLD(variation.seed), INT32_MIN, INT32_MAX},
    {"sensor_seed", SIGNED32, WORLD(instrument.seed), INT32_MIN, INT32_MAX},
    {"pass_ms", COUNT32, WORLD(pass_ms), 0, INT32_MAX},
    {"scan_ms", COUNT32, WORLD(scan_ms), 0, INT32_MAX},
    {"home_ms", COUNT32, WORLD(home_ms), 0, INT32_MAX},
    {"move_ms", COUNT32, WORLD(move_ms), 0, INT32_MAX},
    {"purge_ms", COUNT32, WORLD(purge_ms), 0, INT32_MAX},
    {"gate_ms", COUNT32, WORLD(gate_ms), 0, INT32_MAX},
    {"watchdog_ms", COUNT32, WORLD(watchdog_ms), 0, INT32_MAX},
    {"alive_ms", COUNT32, offsetof(BenchOptions, limits.alive), 1, INT32_MAX},
    {"lamp_limit_ms", COUNT32, offsetof(BenchOptions, limits.lamp), 0, INT32_MAX},
    {"one_node", FLAG, offsetof(BenchOptions, one_node), 0, 1},
};

static const char *const NAMES[BENCH_NODES] = {"head", "stage", "cure", "profiler"};
static const uint8_t ROLES[BENCH_NODES] = {ROLE_HEAD, ROLE_STAGE, ROLE_CURE, ROLE_PROFILER};
enum { ALL_ROLES = ROLE_HEAD | ROLE_STAGE | ROLE_CURE | ROLE_PROFILER };

BenchOptions bench_defaults(void) {
    return (BenchOptions){.world = world_defaults(), .limits = NODE_LIMITS};
}

static bool is_value(const Option *option, double value) {
    const bool whole = value == rint(value) && fabs(value) <= INT32_MAX;
    return isfinite(value) && (option->type == REAL || whole) && value >= option->min && value <= option->max;
}

static void store(void *to, Type type, double value) {
    switch (type) {
    case REAL:
        *(double *)to = value;
        break;
    case COUNT16:
        *(uint16_t *)to = (uint16_t)value;
        break;
    case COUNT32:
        *(uint32_t *)to = (uint32_t)value;
        break;
    case SIGNED32:
        *(int32_t *)to = (int32_t)value;
        break;
    case KIND:
        *(VariationKind *)to = (VariationKind)value;
        break;
    case FLAG:
        *(bool *)to = value != 0.0;
    }
}

bool bench_set(BenchOptions *options, const char *name, double value) {
    for (size_t k = 0; k < sizeof OPTIONS / sizeof *OPTIONS; k++) {
        const Option *option = &OPTIONS[k];
        if (strcmp(option->name, name) != 0)
            continue;
        if (is_value(option, value))
            store((char *)options + option->at, option->type, value);
        return is_value(option, value);
    }
    return false;
}

const char *bench_fault(const BenchOptions *options) {
    const WorldOptions *world = &options->world;
    const double nanometres = world->instrument.resolution * 1e9;
    if ((uint32_t)world->nx * world->ny > PATTERN_CELLS_MAX)
        return "nx * ny is above 1000000 cells, the largest pattern of the protocol";
    if (nanometres < 0.5 || nanometres > UINT16_MAX || fabs(nanometres - rint(nanometres)) > 1e-6)
        return "resolution is not a whole number of nanometres from 1 to 65535: a map on the bus has such steps";
    return NULL;
}

static const char *open_files(Bench *bench, const char *folder) {
    char path[sizeof bench->surface_path];
    for (int node = 0; node < bench_node_count(bench); node++) {
        const int length = snprintf(path, sizeof path, "%s/journal-%s.bin", folder, NAMES[node]);
        if (length < 0 || (size_t)length >= sizeof path || !board_open_file(&bench->board[node], path))
            return "a journal could not be opened or made in the folder";
    }
    snprintf(bench->surface_path, sizeof bench->surface_path, "%s/surface.bin", folder);
    return surface_file_read(&bench->world, bench->surface_path);
}

static uint32_t cells_of(const BenchOptions *options) {
    return (uint32_t)options->world.nx * options->world.ny;
}

static uint32_t patterns_size(const BenchOptions *options) {
    return (2 * cells_of(options) + 7) / 8;
}

size_t bench_size(const BenchOptions *options) {
    return sizeof(Bench) + world_size(&options->world) + patterns_size(options);
}

/* The memory behind the bench: the grids of the world, then the patterns of the head. */
static void *grids_of(Bench *bench) {
    return bench + 1;
}

static uint8_t *pattern_memory(Bench *bench) {
    return (uint8_t *)grids_of(bench) + world_size(&bench->options.world);
}

void bench_link(Bench *bench) {
    world_link(&bench->world, grids_of(bench));
    for (int k = 0; k < bench_node_count(bench); k++) {
        Board *board = &bench->board[k];
        Node *node = &bench->node[k];
        board->world = &bench->world;
        board->surface_path = bench->surface_path;
        board->work.pattern = &node->pattern;
        bench->hal[k] = board_hal(board);
        node->hal = node->journal.hal = &bench->hal[k];
        node->options.pattern_memory = node->pattern.cells = k == BENCH_HEAD ? pattern_memory(bench) : NULL;
    }
}

void bench_unlink(Bench *bench) {
    world_link(&bench->world, NULL);
    memset(bench->hal, 0, sizeof bench->hal);
    for (int k = 0; k < bench_node_count(bench); k++) {
        Node *node = &bench->node[k];
        bench->board[k].world = NULL;
        bench->board[k].surface_path = NULL;
        bench->board[k].work.pattern = NULL;
        node->hal = node->journal.hal = NULL;
        node->options.pattern_memory = node->pattern.cells = NULL;
    }
}

Bench *bench_init(void *memory, const BenchOptions *options) {
    Bench *bench = memory;
    bench->options = *options;
    bench->pattern_bytes = patterns_size(options);
    world_init(&bench->world, &options->world, grids_of(bench));
    for (int node = 0; node < BENCH_NODES; node++) {
        Board *board = &bench->board[node];
        board_init(board, &bench->world, bench->surface_path);
        bench->hal[node] = board_hal(board);
    }
    return bench;
}

Bench *bench_create(const BenchOptions *options, const char *folder, char *why, size_t room) {
    const char *fault = bench_fault(options);
    void *memory = fault ? NULL : calloc(1, bench_size(options));
    Bench *bench = memory ? bench_init(memory, options) : NULL;
    if (bench && folder)
        fault = open_files(bench, folder);
    else if (!bench && !fault)
        fault = "there is no memory for a grid of this size";
    if (!fault)
        return bench;
    snprintf(why, room, "%s", fault);
    bench_delete(bench);
    return NULL;
}

void bench_delete(Bench *bench) {
    if (!bench)
        return;
    for (int node = 0; node < BENCH_NODES; node++)
        if (bench->board[node].file)
            fclose(bench->board[node].file);
    free(bench);
}

int bench_node_count(const Bench *bench) {
    return bench->options.one_node ? 1 : BENCH_NODES;
}

void bench_power_up(Bench *bench, int node, uint32_t now) {
    const bool head = node == BENCH_HEAD;
    Board *board = &bench->board[node];
    NodeOptions options;
    memset(&options, 0, sizeof options); /* also between its members: equal benches are equal bytes */
    options.roles = bench->options.one_node ? ALL_ROLES : ROLES[node];
    options.limits = bench->options.limits;
    options.pattern_memory = head ? pattern_memory(bench) : NULL;
    options.pattern_bytes = head ? bench->pattern_bytes : 0;
    options.by_watchdog = board->by_watchdog;
    world_tick(&bench->world, now);
    board->torn_at = -1;
    board->watched = board->by_watchdog = false;
    node_init(&bench->node[node], &options, &bench->hal[node], now);
}

void bench_power_off(Bench *bench, int node) {
    const Hal *hal = &bench->hal[node];
    if (node == BENCH_CURE || bench->options.one_node)
        hal->set_lamp(hal->context, false);
    if (node == BENCH_HEAD)
        hal->set_gate(hal->context, false);
    hal->halt(hal->context);
    bench->board[node].watched = false;
}

void bench_decay(Bench *bench, int node, uint32_t count) {
    enum { IN_SECTOR = BOARD_SECTOR_BYTES / RECORD_BYTES, SLOTS = BOARD_SECTORS * IN_SECTOR };
    _Static_assert(RECORD_BYTES % BOARD_WRITE_UNIT == 0, "records are whole words without padding");
    for (uint32_t back = 1; back <= count && back <= SLOTS; back++) {
        const uint32_t slot = (bench->node[node].journal.next + SLOTS - back) % SLOTS;
        const uint32_t at = slot / IN_SECTOR * BOARD_SECTOR_BYTES + slot % IN_SECTOR * RECORD_BYTES;
        memset(bench->board[node].unreadable + at / BOARD_WRITE_UNIT, true, RECORD_BYTES / BOARD_WRITE_UNIT);
    }
}

bool bench_watchdog_bites(Bench *bench, int node, uint32_t now) {
    Board *board = &bench->board[node];
    if (!board->watched || now - board->kicked_at < bench->world.options.watchdog_ms)
        return false;
    world_tick(&bench->world, board->kicked_at + bench->world.options.watchdog_ms);
    bench_power_off(bench, node);
    world_tick(&bench->world, now);
    board->by_watchdog = true;
    return true;
}

bool bench_is_well(const Bench *bench) {
    for (int node = 0; node < bench_node_count(bench); node++)
        if (!bench->board[node].watched || bench->board[node].kicked_at != bench->world.now)
            return false;
    return true;
}
