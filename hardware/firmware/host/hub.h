/* A CAN bus of serial adapters (slcan) on this machine: each client of a TCP port on 127.0.0.1, or the one behind a
 * pseudo-terminal, is an adapter on the same bus and sees what all others send. The bus never waits: frames for a
 * client whose buffer is full are dropped and counted, as an adapter does, and a client that does not read for
 * HUB_PATIENCE is disconnected. The bus is as fast as the machine; no bit rate is emulated. POSIX. */
#ifndef INKLOOP_HUB_H
#define INKLOOP_HUB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "slcan.h"

enum { HUB_CLIENTS = 8, HUB_BUFFER = 65536, HUB_PATIENCE = 10000 /* ms */ };

typedef struct {
    int file; /* -1: none */
    bool terminal;
    bool bus_off;   /* until its channel is closed: it receives nothing and refuses to send with BEL */
    bool relapsing; /* it goes bus-off again with the next frame that it sends */
    Slcan slcan;
    uint32_t dropped;  /* frames */
    size_t used;       /* bytes of `out` that wait */
    uint32_t moved_at; /* when a byte was taken from it last, or it was empty [ms] */
    char out[HUB_BUFFER];
} HubClient;

typedef struct {
    int listener;  /* -1: none */
    int kept_open; /* the other end of the pseudo-terminal, so that it outlives its user; -1: none */
    HubClient client[HUB_CLIENTS];
    int sender;        /* whose frame is handed on */
    uint32_t refusals; /* connections that will be closed as soon as they are made */
    uint32_t relapses; /* so often an adapter that comes back from bus-off is bus-off again at its first frame */
} Hub;

typedef void HubTake(void *context, const CanFrame *frame);

void hub_init(Hub *hub);
void hub_close(Hub *hub);

/* Listens on 127.0.0.1; `port` 0 takes a free one. The port, or -1 with errno. */
int hub_listen(Hub *hub, uint16_t port);

/* Makes a pseudo-terminal; false with errno. */
bool hub_open_terminal(Hub *hub, char *path, size_t room);

/* Waits up to `wait_ms` for something to happen, takes what clients sent and hands every frame on, also to `take`. */
void hub_turn(Hub *hub, int wait_ms, uint32_t now, HubTake *take, void *context);

/* To all clients that have opened their channel. */
void hub_send(Hub *hub, const CanFrame *frame);

/* Bytes in place of a frame, to the same ones. */
void hub_send_line(Hub *hub, const char *bytes, size_t length);

/* Ends the connection of a client, and the next `refusals` ones; a pseudo-terminal is gone for good. */
void hub_unplug(Hub *hub, int client, uint32_t refusals);

/* Sends an adapter bus-off, `times` times: each time until its channel is closed and opened again. */
void hub_bus_off(Hub *hub, int client, uint32_t times);

#endif
