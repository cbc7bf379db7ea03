/* The emulator as a process: four nodes on an slcan bus, with journals and surface in a folder.
 *
 *     inkloop_bench_nodes [--port N | --pty] [--folder DIR] [--until-stdin-closes] [--fault KIND[:key=value,...]]
 *                         [option=value ...]
 *
 * The first line it prints is the channel: "socket://127.0.0.1:PORT" or the path of a terminal. */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "emulation.h"
#include "fault_text.h"
#include "hub.h"
#include "inkloop.h"

enum { TURN_MS = 1, TEXT = 300 };

typedef struct {
    BenchOptions bench;
    const char *folder;
    uint16_t port;
    bool terminal, until_stdin_closes;
    Faults *faults;
    char why[TEXT]; /* message about a fault that is not understood */
} Options;

typedef struct {
    Emulation emulation;
    Hub hub;
    int master; /* client of the last MasterAlive */
} Nodes;

static volatile sig_atomic_t asked_to_end;

static void end(int signal_number) {
    (void)signal_number;
    asked_to_end = 1;
}

/* Milliseconds since the process began: a node counts from its power-up. */
static uint32_t clock_ms(void) {
    static struct timespec start;
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (start.tv_sec == 0 && start.tv_nsec == 0)
        start = now;
    return (uint32_t)((now.tv_sec - start.tv_sec) * 1000 + (now.tv_nsec - start.tv_nsec) / 1000000);
}

static bool read_option(Options *options, const char *text) {
    char name[TEXT];
    const char *equals = strchr(text, '=');
    const size_t length = equals ? (size_t)(equals - text) : 0;
    if (length == 0 || length >= sizeof name)
        return false;
    memcpy(name, text, length);
    name[length] = '\0';
    char *rest;
    const double value = strtod(equals + 1, &rest);
    return rest != equals + 1 && *rest == '\0' && bench_set(&options->bench, name, value);
}

static bool read_port(Options *options, const char *text) {
    char *rest;
    const long port = strtol(text, &rest, 10);
    options->port = (uint16_t)port;
    return rest != text && *rest == '\0' && port >= 0 && port <= UINT16_MAX;
}

static bool read_fault(Options *options, const char *text) {
    return faults_add(options->faults, text, options->why, sizeof options->why);
}

/* The first invalid argument, NULL if there is none. */
static const char *read_arguments(Options *options, int count, char **arguments) {
    for (int k = 1; k < count; k++) {
        const char *argument = arguments[k];
        const char *next = k + 1 < count ? arguments[k + 1] : NULL;
        bool good = true;
        if (strcmp(argument, "--pty") == 0)
            options->terminal = true;
        else if (strcmp(argument, "--until-stdin-closes") == 0)
            options->until_stdin_closes = true;
        else if (strcmp(argument, "--folder") == 0 && next)
            options->folder = arguments[++k];
        else if (strcmp(argument, "--fault") == 0 && next)
            good = read_fault(options, arguments[++k]);
        else if (strcmp(argument, "--port") == 0 && next)
            good = read_port(options, arguments[++k]);
        else
            good = read_option(options, argument);
        if (!good)
            return arguments[k];
    }
    return NULL;
}

static void send_frame(void *context, const CanFrame *frame) {
    hub_send(&((Nodes *)context)->hub, frame);
}

static void send_line(void *context, const char *bytes, size_t length) {
    hub_send_line(&((Nodes *)context)->hub, bytes, length);
}

static void unplug(void *context, uint32_t refusals) {
    Nodes *nodes = context;
    hub_unplug(&nodes->hub, nodes->master, refusals);
}

static void bus_off(void *context, uint32_t times) {
    Nodes *nodes = context;
    hub_bus_off(&nodes->hub, nodes->master, times);
}

static void take(void *context, const CanFrame *frame) {
    Nodes *nodes = context;
    if (frame->id == INKLOOP_MASTER_ALIVE_FRAME_ID)
        nodes->master = nodes->hub.sender;
    emulation_take(&nodes->emulation, frame);
}

static bool stdin_is_closed(void) {
    struct pollfd polled = {.fd = STDIN_FILENO, .events = POLLIN};
    char byte;
    return poll(&polled, 1, 0) > 0 && read(STDIN_FILENO, &byte, 1) == 0;
}

static bool open_channel(Hub *hub, const Options *options) {
    char path[TEXT];
    hub_init(hub);
    if (options->terminal) {
        if (!hub_open_terminal(hub, path, sizeof path))
            return false;
        printf("%s\n", path);
    } else {
        const int port = hub_listen(hub, options->port);
        if (port < 0)
            return false;
        printf("socket://127.0.0.1:%d\n", port);
    }
    fflush(stdout);
    return true;
}

int main(int count, char **arguments) {
    static Nodes nodes;
    Options options = {.bench = bench_defaults(), .faults = &nodes.emulation.faults, .why = ""};
    char why[TEXT];
    const char *wrong = read_arguments(&options, count, arguments);
    if (wrong) {
        static const char EXPECTED[] =
            "expected --port N, --pty, --folder DIR, --until-stdin-closes, --fault KIND[:key=value,...], or an option "
            "with its value in SI, such as nx=40 or variation=0.1";
        fprintf(stderr, "inkloop_bench_nodes: %s is not understood; %s\n", wrong,
                options.why[0] ? options.why : EXPECTED);
        return 2;
    }
    Bench *bench = bench_create(&options.bench, options.folder, why, sizeof why);
    if (!bench) {
        fprintf(stderr, "inkloop_bench_nodes: %s\n", why);
        return 1;
    }
    const EmulationBus bus = {.context = &nodes, .frame = send_frame, .line = send_line};
    const MasterAdapter adapter = {.context = &nodes, .unplug = unplug, .bus_off = bus_off};
    emulation_begin(&nodes.emulation, bench, &bus, &adapter, clock_ms());
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* a file that must not grow is like a full disk: writing fails */
    signal(SIGTERM, end);
    signal(SIGINT, end);
    if (!open_channel(&nodes.hub, &options)) {
        fprintf(stderr, "inkloop_bench_nodes: the channel could not be opened: %s\n", strerror(errno));
        bench_delete(bench);
        return 1;
    }
    while (!asked_to_end && !(options.until_stdin_closes && stdin_is_closed())) {
        nodes.emulation.now = clock_ms();
        hub_turn(&nodes.hub, TURN_MS, nodes.emulation.now, take, &nodes);
        emulation_turn(&nodes.emulation, clock_ms());
    }
    hub_close(&nodes.hub);
    bench_delete(bench);
    return 0;
}
