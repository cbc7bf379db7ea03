/* A process at the other end of a slcan line: answers every ISO-TP message of 0x640 with its bytes in reverse on 0x641.
 * Listens on a free port of 127.0.0.1, prints it, serves one connection and ends with it. */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "isotp.h"
#include "slcan.h"

static uint32_t clock_ms(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)now.tv_sec * 1000u + (uint32_t)(now.tv_nsec / 1000000);
}

static int connected(void) {
    struct sockaddr_in place = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof place;
    const int listener = socket(AF_INET, SOCK_STREAM, 0), yes = 1;
    if (bind(listener, (struct sockaddr *)&place, length) || listen(listener, 1) ||
        getsockname(listener, (struct sockaddr *)&place, &length))
        return -1;
    printf("%d\n", ntohs(place.sin_port));
    fflush(stdout);
    const int line = accept(listener, NULL, NULL);
    setsockopt(line, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    return line;
}

static void echo(Isotp *end) {
    static uint8_t reversed[ISOTP_LENGTH_MAX];
    size_t length;
    const uint8_t *message = isotp_received(end, &length);
    for (size_t i = 0; i < length; i++)
        reversed[i] = message[length - 1 - i];
    if (length && isotp_send(end, reversed, length))
        isotp_release(end);
}

int main(void) {
    static Isotp end;
    static Slcan slcan;
    const IsotpOptions options = {.receive_id = 0x640,
                                  .send_id = 0x641,
                                  .block_size = 16,
                                  .padding = 0xCC,
                                  .flow_timeout = 1000,
                                  .frame_timeout = 1000};
    uint8_t bytes[512];
    char text[SLCAN_LINE_MAX];
    CanFrame frame;
    SlcanEvent event;
    isotp_init(&end, &options);
    slcan_init(&slcan);
    const int line = connected();
    for (ssize_t read_bytes = 0; line >= 0;) {
        struct pollfd waiting = {.fd = line, .events = POLLIN};
        if (poll(&waiting, 1, 5) > 0 && (read_bytes = read(line, bytes, sizeof bytes)) <= 0)
            return 0;
        for (ssize_t i = 0; i < read_bytes; i++) {
            if (!slcan_take(&slcan, bytes[i], &event))
                continue;
            if (event.has_frame)
                isotp_take(&end, &event.frame, clock_ms());
            if (write(line, event.answer, event.answer_length) < 0)
                return 0;
        }
        read_bytes = 0;
        isotp_tick(&end, clock_ms());
        echo(&end);
        while (isotp_next(&end, clock_ms(), &frame))
            if (write(line, text, slcan_write(&frame, text)) < 0)
                return 0;
    }
    return 1;
}
