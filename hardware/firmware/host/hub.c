#define _DEFAULT_SOURCE
#define _XOPEN_SOURCE 700
#ifdef __APPLE__
#define _DARWIN_C_SOURCE
#endif
#include "hub.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

enum { READ_AT_ONCE = 512 /* about 20 frames: they fit into the queue of a node */, NO_FILE = -1 };
static const char BEL[] = "\a";

void hub_init(Hub *hub) {
    hub->listener = hub->kept_open = NO_FILE;
    for (int k = 0; k < HUB_CLIENTS; k++)
        hub->client[k].file = NO_FILE;
}

static void put_off(HubClient *client) {
    if (client->terminal) { /* the device stays; the next user starts from a reset adapter */
        slcan_init(&client->slcan);
        client->used = 0;
        return;
    }
    close(client->file);
    client->file = NO_FILE;
}

void hub_close(Hub *hub) {
    for (int k = 0; k < HUB_CLIENTS; k++)
        if (hub->client[k].file != NO_FILE)
            close(hub->client[k].file);
    if (hub->listener != NO_FILE)
        close(hub->listener);
    if (hub->kept_open != NO_FILE)
        close(hub->kept_open);
    hub_init(hub);
}

static bool do_not_block(int file) {
    const int flags = fcntl(file, F_GETFL, 0);
    return flags >= 0 && fcntl(file, F_SETFL, flags | O_NONBLOCK) == 0;
}

static HubClient *add_client(Hub *hub, int file, bool terminal, uint32_t now) {
    for (int k = 0; k < HUB_CLIENTS; k++) {
        HubClient *client = &hub->client[k];
        if (client->file != NO_FILE)
            continue;
        client->file = file;
        client->terminal = terminal;
        client->used = 0;
        client->dropped = 0;
        client->moved_at = now;
        client->bus_off = false;
        client->relapsing = hub->relapses > 0;
        slcan_init(&client->slcan);
        return client;
    }
    return NULL;
}

int hub_listen(Hub *hub, uint16_t port) {
    const int file = socket(AF_INET, SOCK_STREAM, 0);
    if (file < 0)
        return -1;
    const int yes = 1;
    setsockopt(file, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(port)};
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof address;
    if (bind(file, (struct sockaddr *)&address, sizeof address) != 0 || listen(file, HUB_CLIENTS) != 0 ||
        getsockname(file, (struct sockaddr *)&address, &length) != 0 || !do_not_block(file)) {
        const int reason = errno;
        close(file);
        errno = reason;
        return -1;
    }
    hub->listener = file;
    return ntohs(address.sin_port);
}

bool hub_open_terminal(Hub *hub, char *path, size_t room) {
    const int file = posix_openpt(O_RDWR | O_NOCTTY);
    if (file < 0)
        return false;
    const char *name = grantpt(file) == 0 && unlockpt(file) == 0 ? ptsname(file) : NULL;
    const int other = name && strlen(name) < room ? open(name, O_RDWR | O_NOCTTY) : -1;
    struct termios raw;
    if (other < 0 || tcgetattr(other, &raw) != 0) {
        close(file);
        return false;
    }
    cfmakeraw(&raw);
    tcsetattr(other, TCSANOW, &raw);
    strcpy(path, name);
    hub->kept_open = other;
    return do_not_block(file) && add_client(hub, file, true, 0) != NULL;
}

static void put(HubClient *client, const char *bytes, size_t length) {
    if (length > HUB_BUFFER - client->used) {
        client->dropped++;
        return;
    }
    memcpy(client->out + client->used, bytes, length);
    client->used += length;
}

static void put_except(Hub *hub, const char *bytes, size_t length, const HubClient *sender) {
    for (int k = 0; k < HUB_CLIENTS; k++) {
        HubClient *client = &hub->client[k];
        if (client->file != NO_FILE && client != sender && client->slcan.open && !client->bus_off)
            put(client, bytes, length);
    }
}

static void send_except(Hub *hub, const CanFrame *frame, const HubClient *sender) {
    char line[SLCAN_LINE_MAX];
    put_except(hub, line, slcan_write(frame, line), sender);
}

void hub_send(Hub *hub, const CanFrame *frame) {
    send_except(hub, frame, NULL);
}

void hub_send_line(Hub *hub, const char *bytes, size_t length) {
    put_except(hub, bytes, length, NULL);
}

void hub_unplug(Hub *hub, int client, uint32_t refusals) {
    HubClient *gone = &hub->client[client];
    hub->refusals = refusals;
    if (gone->file == NO_FILE)
        return;
    if (gone->terminal && hub->kept_open != NO_FILE) {
        close(hub->kept_open);
        hub->kept_open = NO_FILE;
    }
    gone->terminal = false;
    put_off(gone);
}

void hub_bus_off(Hub *hub, int client, uint32_t times) {
    hub->client[client].bus_off = hub->client[client].file != NO_FILE;
    hub->relapses = times - 1;
}

/* Whether an adapter is bus-off. Closing its channel ends that. */
static bool is_bus_off(Hub *hub, HubClient *client, bool sends) {
    if (client->bus_off && !client->slcan.open) {
        client->bus_off = false;
        client->relapsing = hub->relapses > 0;
    } else if (sends && client->relapsing) {
        hub->relapses--;
        client->relapsing = false;
        client->bus_off = true;
    }
    return client->bus_off;
}

static void flush(HubClient *client, uint32_t now) {
    const ssize_t written = client->used > 0 ? write(client->file, client->out, client->used) : 0;
    if (written > 0) {
        client->used -= (size_t)written;
        memmove(client->out, client->out + written, client->used);
    }
    if (written > 0 || client->used == 0)
        client->moved_at = now;
    const bool gone = written < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR;
    if (gone || now - client->moved_at >= HUB_PATIENCE)
        put_off(client);
}

static void take_bytes(Hub *hub, HubClient *client, HubTake *take, void *context) {
    uint8_t bytes[READ_AT_ONCE];
    const ssize_t got = read(client->file, bytes, sizeof bytes);
    if (got == 0 || (got < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) {
        put_off(client);
        return;
    }
    for (ssize_t k = 0; k < got; k++) {
        SlcanEvent event;
        if (!slcan_take(&client->slcan, bytes[k], &event))
            continue;
        const bool off = is_bus_off(hub, client, event.has_frame);
        if (off && event.has_frame)
            put(client, BEL, sizeof BEL - 1);
        else
            put(client, event.answer, event.answer_length);
        if (off || !event.has_frame)
            continue;
        send_except(hub, &event.frame, client);
        hub->sender = (int)(client - hub->client);
        take(context, &event.frame);
        if (client->file == NO_FILE) /* unplugged meanwhile */
            return;
    }
}

static void welcome(Hub *hub, uint32_t now) {
    const int file = accept(hub->listener, NULL, NULL);
    if (file < 0)
        return;
    const int yes = 1;
    setsockopt(file, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    const bool refused = hub->refusals > 0;
    hub->refusals -= refused ? 1 : 0;
    if (refused || !do_not_block(file) || !add_client(hub, file, false, now))
        close(file);
}

void hub_turn(Hub *hub, int wait_ms, uint32_t now, HubTake *take, void *context) {
    struct pollfd polled[HUB_CLIENTS + 1];
    for (int k = 0; k < HUB_CLIENTS; k++) {
        const HubClient *client = &hub->client[k];
        const int events = POLLIN | (client->used > 0 ? POLLOUT : 0);
        polled[k] = (struct pollfd){.fd = client->file, .events = (short)events};
    }
    polled[HUB_CLIENTS] = (struct pollfd){.fd = hub->listener, .events = POLLIN};
    if (poll(polled, HUB_CLIENTS + 1, wait_ms) > 0) {
        for (int k = 0; k < HUB_CLIENTS; k++)
            if (polled[k].revents & (POLLIN | POLLHUP | POLLERR))
                take_bytes(hub, &hub->client[k], take, context);
        if (polled[HUB_CLIENTS].revents & POLLIN)
            welcome(hub, now);
    }
    for (int k = 0; k < HUB_CLIENTS; k++)
        if (hub->client[k].file != NO_FILE)
            flush(&hub->client[k], now);
}
