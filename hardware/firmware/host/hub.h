/* A CAN bus of serial adapters (slcan) on this machine: each client of a TCP port on 127.0.0.1, or the one behind a
 * pseudo-terminal, is an adapter on the same bus and sees the frames of all others. The bus never waits: frames for a
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
    size_t used;       /* bytes waiting in `out` */
    uint32_t moved_at; /* time when the client last read a byte, or `out` was empty [ms] */
    char out[HUB_BUFFER];
} HubClient;

typedef struct {
    int listener;  /* -1: none */
    int kept_open; /* the other end of the pseudo-terminal, kept open so that it outlives its user; -1: none */
    HubClient client[HUB_CLIENTS];
    int sender;        /* client whose frame is being delivered */
    uint32_t refusals; /* connections that will be closed as soon as they are made */
    uint32_t relapses; /* times that an adapter goes bus-off again at its first frame after bus-off */
} Hub;

typedef void HubTake(void *context, const CanFrame *frame);

void hub_init(Hub *hub);
void hub_close(Hub *hub);

/* Listens on 127.0.0.1; `port` 0 takes a free one. The port, or -1 with errno. */
int hub_listen(Hub *hub, uint16_t port);

/* Makes a pseudo-terminal; false with errno. */
bool hub_open_terminal(Hub *hub, char *path, size_t room);

/* Waits up to `wait_ms` for input, reads from the clients and delivers every frame, also to `take`. */
void hub_turn(Hub *hub, int wait_ms, uint32_t now, HubTake *take, void *context);

/* Sends to all clients that have opened their channel. */
void hub_send(Hub *hub, const CanFrame *frame);

/* Sends bytes in place of a frame, to the same clients. */
void hub_send_line(Hub *hub, const char *bytes, size_t length);

/* Ends the connection of a client, and the next `refusals` ones; a pseudo-terminal is closed for good. */
void hub_unplug(Hub *hub, int client, uint32_t refusals);

/* Sets an adapter bus-off `times` times: each time until its channel is closed and opened again. */
void hub_bus_off(Hub *hub, int client, uint32_t times);

#endif
