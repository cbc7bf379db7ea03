/* A master that asks a node byte by byte, without a bus, and what holds of the answers. */
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

/* One tick after so many ms, and all laws. */
void bench_turn(Bench *bench, uint32_t milliseconds);

/* Time as it should pass: a tick every 10 ms, a living master. */
void bench_live(Bench *bench, int ticks);

void bench_say_alive(Bench *bench, const MasterAlive *master);
void bench_power_up(Bench *bench);

/* A request; whether the answer that comes at once is positive. */
bool bench_ask_once(Bench *bench, const uint8_t *request, size_t length);

/* To the end of the step; what was done is then done before. */
void bench_ask_to_the_end(Bench *bench, const uint8_t *request, size_t length);

/* Gives the memory of the last request and its answer back. */
void bench_forget(Bench *bench);

#endif
