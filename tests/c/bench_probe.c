/* Access of firmware tests to nodes besides their messages: reads and breaks their state. */
#include <string.h>

#include "bench.h"
#include "measurements.h"
#include "node_frames.h"

BenchOptions *probe_options(void);
size_t probe_options_size(void);
Node *probe_node(Bench *bench, int node);
void probe_tick(Bench *bench, uint32_t now);
double *probe_surface(Bench *bench);
uint8_t *probe_storage(Bench *bench, int node);
void probe_break(Bench *bench, uint32_t what);
void probe_tear(Bench *bench, int node, int32_t bytes);
void probe_wear(Bench *bench, int node);
uint32_t probe_count(Bench *bench, int what);
void probe_refuse_slots(Bench *bench, int node, uint32_t from, uint32_t to);
void probe_decay(Bench *bench, int node, uint32_t offset);
void probe_memory(Bench *bench, int node, uint32_t sectors, uint32_t sector_bytes, uint32_t write_unit);
void probe_restore(Bench *bench, int node);
void probe_erase_slowly(Bench *bench, int node, uint32_t milliseconds);
void probe_refuse_work(Bench *bench, int node);
void probe_light_while_recording(Bench *bench, int node);
void probe_roles(Bench *bench, int node, int roles);
void probe_drive_gate(Bench *bench, int node);
void probe_drive_lamp(Bench *bench, int node);
void probe_work(Bench *bench, int node, uint32_t numbers[5]);
void probe_join(Bench *bench, int node);
void probe_frame(int node, uint32_t id, const uint8_t *data, int length, uint32_t now);
int probe_next(int node, uint32_t now, uint32_t *id, uint8_t *data);
int probe_measurement(Bench *bench, Measurements *measurements, int node, uint32_t now, uint32_t *id, uint8_t *data);

static NodeFrames frames[BENCH_NODES];
static Hal sound, faulty;

BenchOptions *probe_options(void) {
    static BenchOptions options;
    options = bench_defaults();
    return &options;
}

size_t probe_options_size(void) {
    return sizeof(BenchOptions);
}

Node *probe_node(Bench *bench, int node) {
    return &bench->node[node];
}

/* Advances the world and every node to `now`; a node that the watchdog has switched off starts again. */
void probe_tick(Bench *bench, uint32_t now) {
    world_tick(&bench->world, now);
    for (int node = 0; node < bench_node_count(bench); node++) {
        if (bench_watchdog_bites(bench, node, now))
            bench_power_up(bench, node, now);
        node_tick(&bench->node[node], now);
    }
}

double *probe_surface(Bench *bench) {
    return bench->world.height;
}

uint8_t *probe_storage(Bench *bench, int node) {
    return bench->board[node].storage;
}

void probe_break(Bench *bench, uint32_t what) {
    bench->world.broken = what;
}

void probe_tear(Bench *bench, int node, int32_t bytes) {
    bench->board[node].torn_at = bytes;
}

static bool write_with_a_dead_bit(void *context, uint32_t offset, const uint8_t *from, uint32_t length) {
    Board *board = context;
    const bool written = sound.storage_write(context, offset, from, length);
    board->storage[offset] ^= 1;
    return written;
}

/* From now on a node writes its records by this function. */
static void replace_write(Bench *bench, int number, bool (*write)(void *, uint32_t, const uint8_t *, uint32_t)) {
    Node *node = &bench->node[number];
    sound = *node->hal;
    faulty = sound;
    faulty.storage_write = write;
    node->hal = node->journal.hal = &faulty;
}

/* From now on the flash of a node reports that it has written a record, and holds another one. */
void probe_wear(Bench *bench, int node) {
    replace_write(bench, node, write_with_a_dead_bit);
}

static uint32_t refused_from, refused_to;

static bool write_elsewhere(void *context, uint32_t offset, const uint8_t *from, uint32_t length) {
    return (offset < refused_from || offset >= refused_to) && sound.storage_write(context, offset, from, length);
}

/* From now on a node's storage refuses to write at these offsets, whatever they read. */
void probe_refuse_slots(Bench *bench, int node, uint32_t from, uint32_t to) {
    refused_from = from;
    refused_to = to;
    sound = board_hal(&bench->board[node]);
    bench->hal[node].storage_write = write_elsewhere;
}

/* A record at this offset cannot be read any more. */
void probe_decay(Bench *bench, int node, uint32_t offset) {
    memset(bench->board[node].unreadable + offset / BOARD_WRITE_UNIT, true, RECORD_BYTES / BOARD_WRITE_UNIT);
}

/* The memory of a node, from its next power-up on. */
void probe_memory(Bench *bench, int node, uint32_t sectors, uint32_t sector_bytes, uint32_t write_unit) {
    Hal *hal = &bench->hal[node];
    hal->sectors = sectors;
    hal->sector_bytes = sector_bytes;
    hal->write_unit = write_unit;
    if (write_unit > 0)
        bench->board[node].write_unit = write_unit;
}

/* Storage that failed to read or write is as good as new. */
void probe_restore(Bench *bench, int node) {
    Board *board = &bench->board[node];
    memset(board->unreadable, 0, sizeof board->unreadable);
    bench->hal[node] = board_hal(board);
}

static uint32_t erasing_ms;

static bool erase_slowly(void *context, uint32_t sector) {
    Board *board = context;
    world_tick(board->world, board->world->now + erasing_ms);
    return sound.storage_erase(context, sector);
}

/* From now on an erasure takes so long, by the clock of the world. */
void probe_erase_slowly(Bench *bench, int node, uint32_t milliseconds) {
    erasing_ms = milliseconds;
    sound = board_hal(&bench->board[node]);
    bench->hal[node].storage_erase = erase_slowly;
}

static bool begin_nothing(void *context, const Work *work) {
    (void)context;
    (void)work;
    return false;
}

/* From now on the devices of a node cannot begin anything. */
void probe_refuse_work(Bench *bench, int node) {
    Node *refused = &bench->node[node];
    faulty = *refused->hal;
    faulty.begin = begin_nothing;
    refused->hal = refused->journal.hal = &faulty;
}

static bool write_and_light(void *context, uint32_t offset, const uint8_t *from, uint32_t length) {
    Board *board = context;
    board->world->broken |= BROKEN_LAMP_STAYS_ON;
    return sound.storage_write(context, offset, from, length);
}

/* From now on the lamp comes on by itself while a node writes a record, and stays on. */
void probe_light_while_recording(Bench *bench, int node) {
    replace_write(bench, node, write_and_light);
}

uint32_t probe_count(Bench *bench, int what) {
    const World *world = &bench->world;
    const uint32_t counts[] = {world->gate_openings, world->lamp_pulses, world->lamp_with_gate, world->now};
    return counts[what];
}

/* The gate moves, whatever the head drives. */
void probe_move_gate(Bench *bench, int open) {
    world_set_gate(&bench->world, open != 0);
}

/* Gives a node other roles, until its next power-up. */
void probe_roles(Bench *bench, int node, int roles) {
    bench->node[node].options.roles = (uint8_t)roles;
}

/* Effect of a flipped bit of the memory: the node assumes that its gate is driven. */
void probe_drive_gate(Bench *bench, int node) {
    bench->node[node].gate_driven = true;
}

/* The same of its lamp. */
void probe_drive_lamp(Bench *bench, int node) {
    bench->node[node].lamp_driven = true;
}

/* The work that the devices of a node were given last: kind, dry, colour, station, layer. */
void probe_work(Bench *bench, int node, uint32_t numbers[5]) {
    const Work *work = &bench->board[node].work;
    const uint32_t found[] = {work->kind, work->dry, work->colour, work->station, work->layer};
    memcpy(numbers, found, sizeof found);
}

/* Puts a node on a bus of its own. */
void probe_join(Bench *bench, int node) {
    node_frames_init(&frames[node], &bench->node[node], (uint8_t)node);
}

/* Bits of the id beyond its 11 make it an extended one (0x1000) or a remote frame (0x2000). */
void probe_frame(int node, uint32_t id, const uint8_t *data, int length, uint32_t now) {
    CanFrame frame = {
        .id = id & 0x7FF, .length = (uint8_t)length, .extended = (id & 0x1000) != 0, .remote = (id & 0x2000) != 0};
    memcpy(frame.data, data, (size_t)length);
    node_frames_take(&frames[node], &frame, now);
    node_frames_tick(&frames[node], now);
}

static int frame_of(const CanFrame *frame, uint32_t *id, uint8_t *data) {
    *id = frame->id;
    memcpy(data, frame->data, frame->length);
    return frame->length;
}

/* Length of what a node on its bus sends next; 0: nothing. */
int probe_next(int node, uint32_t now, uint32_t *id, uint8_t *data) {
    CanFrame frame;
    return node_frames_next(&frames[node], now, &frame) ? frame_of(&frame, id, data) : 0;
}

/* The same for the measurements. */
int probe_measurement(Bench *bench, Measurements *measurements, int node, uint32_t now, uint32_t *id, uint8_t *data) {
    CanFrame frame;
    return measurements_next(measurements, bench, node, now, &frame) ? frame_of(&frame, id, data) : 0;
}
