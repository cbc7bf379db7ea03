/* What the tests of the firmware look at and break, apart from the messages of its nodes. */
#include <string.h>

#include "bench.h"
#include "node_frames.h"

BenchOptions *probe_options(void);
double *probe_surface(Bench *bench);
uint8_t *probe_storage(Bench *bench, int node);
void probe_break(Bench *bench, uint32_t what);
void probe_tear(Bench *bench, int node, int32_t bytes);
uint32_t probe_count(Bench *bench, int what);
void probe_roles(Bench *bench, int node, int roles);
void probe_drive_gate(Bench *bench, int node);
void probe_join(Bench *bench, int node);
void probe_frame(int node, uint32_t id, const uint8_t *data, int length, uint32_t now);

static NodeFrames frames[BENCH_NODES];

BenchOptions *probe_options(void) {
    static BenchOptions options;
    options = bench_defaults();
    return &options;
}

double *probe_surface(Bench *bench) {
    return bench_world(bench)->height;
}

uint8_t *probe_storage(Bench *bench, int node) {
    return bench_board(bench, node)->storage;
}

void probe_break(Bench *bench, uint32_t what) {
    bench_world(bench)->broken = what;
}

void probe_tear(Bench *bench, int node, int32_t bytes) {
    bench_board(bench, node)->torn_at = bytes;
}

uint32_t probe_count(Bench *bench, int what) {
    const World *world = bench_world(bench);
    const uint32_t counts[] = {world->gate_openings, world->lamp_pulses, world->lamp_with_gate};
    return counts[what];
}

/* Gives a node other roles, until its next power-up. */
void probe_roles(Bench *bench, int node, int roles) {
    bench_node(bench, node)->options.roles = (uint8_t)roles;
}

/* What a flipped bit of the memory does: the node takes its gate for driven. */
void probe_drive_gate(Bench *bench, int node) {
    bench_node(bench, node)->gate_driven = true;
}

/* Puts a node on a bus of its own. */
void probe_join(Bench *bench, int node) {
    node_frames_init(&frames[node], bench_node(bench, node), (uint8_t)node);
}

void probe_frame(int node, uint32_t id, const uint8_t *data, int length, uint32_t now) {
    CanFrame frame = {.id = id, .length = (uint8_t)length};
    memcpy(frame.data, data, (size_t)length);
    node_frames_take(&frames[node], &frame, now);
}
