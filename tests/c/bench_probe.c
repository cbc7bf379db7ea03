/* What the tests of the firmware look at and break, apart from the messages of its nodes. */
#include "bench.h"

BenchOptions *probe_options(void);
double *probe_surface(Bench *bench);
uint8_t *probe_storage(Bench *bench, int node);
void probe_break(Bench *bench, uint32_t what);
void probe_tear(Bench *bench, int node, int32_t bytes);
uint32_t probe_count(Bench *bench, int what);

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
