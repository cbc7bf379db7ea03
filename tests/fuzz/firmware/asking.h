/* A master that sends requests to a node without a bus, and the invariants of the answers. */
#ifndef INKLOOP_FUZZ_ASKING_H
#define INKLOOP_FUZZ_ASKING_H

#include "board.h"
#include "input.h"

enum { ALIVE_EVERY = 100, TICK = 10 }; /* ms */

typedef struct {
    FuzzBoard board;
    Node node;
    NodeOptions options;
    Input input;
    size_t room; /* for answers */
    uint32_t alive_at;
    MasterAlive master;
    uint32_t upload_of;        /* number of the scan whose map is under way */
    uint8_t *request, *answer; /* in memory of just their size */
} Bench;

/* One tick after so many ms; checks all invariants. */
void bench_turn(Bench *bench, uint32_t milliseconds);

/* Normal operation: a tick every 10 ms, a living master. */
void bench_live(Bench *bench, int ticks);

void bench_send_alive(Bench *bench, const MasterAlive *master);
void bench_power_up(Bench *bench);

/* A request; whether the answer that comes at once is positive. */
bool bench_ask_once(Bench *bench, const uint8_t *request, size_t length);

/* A request, until its step has ended; a repeat of it then is answered "done before". */
void bench_ask_to_the_end(Bench *bench, const uint8_t *request, size_t length);

/* Frees the memory of the last request and its answer. */
void bench_forget(Bench *bench);

#endif
