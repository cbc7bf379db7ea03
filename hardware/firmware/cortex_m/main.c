/* The emulator on a Cortex-M3: the same four nodes and the same world as on the host, behind one serial adapter.
 *
 * Journals and surface live in memory: a reset clears them. An image for another board brings its own storage,
 * CAN controller and actuators in place of host/board.c, uart.c and host/world.c. */
#include "bench.h"
#include "clock.h"
#include "measurements.h"
#include "node_frames.h"
#include "slcan.h"
#include "uart.h"
#include "watchdog.h"

enum { BYTES_AT_ONCE = 256, FRAMES_AT_ONCE = 16 };

typedef struct {
    Bench *bench;
    NodeFrames frames[BENCH_NODES];
    Measurements measurements;
    Slcan slcan;
} Machine;

static void send(Machine *machine, const CanFrame *frame) {
    char line[SLCAN_LINE_MAX];
    if (machine->slcan.open)
        uart_send(line, slcan_write(frame, line));
}

static void receive(Machine *machine) {
    uint8_t byte;
    for (int k = 0; k < BYTES_AT_ONCE && uart_take(&byte); k++) {
        SlcanEvent event;
        if (!slcan_take(&machine->slcan, byte, &event))
            continue;
        uart_send(event.answer, event.answer_length);
        for (int node = 0; event.has_frame && node < BENCH_NODES; node++)
            node_frames_take(&machine->frames[node], &event.frame, clock_ms());
    }
}

static void power_up(Machine *machine, int node) {
    bench_power_up(machine->bench, node, clock_ms());
    node_frames_init(&machine->frames[node], &machine->bench->node[node], (uint8_t)node);
}

static void run(Machine *machine, int node) {
    CanFrame frame;
    if (bench_watchdog_bites(machine->bench, node, clock_ms()))
        power_up(machine, node);
    node_frames_tick(&machine->frames[node], clock_ms());
    for (int sent = 0; sent < FRAMES_AT_ONCE && node_frames_next(&machine->frames[node], clock_ms(), &frame); sent++)
        send(machine, &frame);
    if (measurements_next(&machine->measurements, machine->bench, node, clock_ms(), &frame))
        send(machine, &frame);
}

int main(void) {
    static Machine machine;
    BenchOptions options = bench_defaults();
#ifdef ALIVE_MS
    options.limits.alive = ALIVE_MS;
#endif
    char why[80];
    uart_init();
    slcan_init(&machine.slcan);
    machine.bench = bench_create(&options, NULL, why, sizeof why);
    if (!machine.bench)
        return 1;
    for (int node = 0; node < BENCH_NODES; node++)
        power_up(&machine, node);
    for (;;) {
        receive(&machine);
        world_tick(&machine.bench->world, clock_ms());
        for (int node = 0; node < BENCH_NODES; node++)
            run(&machine, node);
        if (bench_is_well(machine.bench))
            watchdog_kick();
    }
}
