/* Invariants of ISO-TP for every length, one damaged frame and every separation; prints the first one that does not
 * hold and ends with 1. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "isotp.h"

enum { ID_A = 0x640, ID_B = 0x641, STEPS_MAX = 20000, DAMAGES = 4000 };

#define INVARIANT(holds)                                                                                               \
    do {                                                                                                               \
        if (!(holds)) {                                                                                                \
            printf("%s:%d: %s\n", __func__, __LINE__, #holds);                                                         \
            exit(1);                                                                                                   \
        }                                                                                                              \
    } while (0)

static uint64_t state = 1;

static uint32_t random_below(uint32_t bound) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(state >> 33) % bound;
}

static Isotp a, b;
static uint8_t message[ISOTP_LENGTH_MAX];

typedef enum { NO_DAMAGE, LOSE, DOUBLE, SWAP } Damage;

static void connect_ends(uint8_t block_size, uint8_t separation) {
    const IsotpOptions options = {.block_size = block_size,
                                  .separation = separation,
                                  .padding = 0xCC,
                                  .wait_max = 3,
                                  .flow_timeout = 1000,
                                  .frame_timeout = 1000};
    IsotpOptions of_a = options, of_b = options;
    of_a.send_id = of_b.receive_id = ID_A;
    of_a.receive_id = of_b.send_id = ID_B;
    isotp_init(&a, &of_a);
    isotp_init(&b, &of_b);
}

/* A sends to B until both are idle; the frame number `victim` of both ways together suffers `damage`. */
static uint32_t transfer(size_t length, Damage damage, uint32_t victim, uint32_t now) {
    INVARIANT(isotp_send(&a, message, length));
    uint32_t count = 0;
    CanFrame frame, kept;
    bool keeps = false;
    for (int step = 0; step < STEPS_MAX; step++, now++) {
        for (int way = 0; way < 2; way++) {
            Isotp *from = way ? &b : &a, *to = way ? &a : &b;
            if (!isotp_next(from, now, &frame))
                continue;
            const bool hit = count++ == victim;
            if (hit && damage == LOSE)
                continue;
            if (hit && damage == SWAP) {
                kept = frame;
                keeps = true;
                continue;
            }
            INVARIANT(isotp_take(to, &frame, now));
            if (hit && damage == DOUBLE)
                isotp_take(to, &frame, now);
            if (keeps && (to->options.receive_id == kept.id)) {
                isotp_take(to, &kept, now);
                keeps = false;
            }
        }
        isotp_tick(&a, now);
        isotp_tick(&b, now);
        if (!isotp_is_sending(&a) && b.receiving.state != ISOTP_RECEIVE_FRAMES && b.receiving.flow == ISOTP_FLOW_NONE)
            return count;
    }
    INVARIANT(!"the transfer ends");
    return 0;
}

static void every_length_arrives(void) {
    static const uint8_t BLOCKS[] = {0, 1, 8, 255};
    size_t length;
    for (size_t k = 0; k < sizeof BLOCKS; k++) {
        for (size_t size = 1; size <= ISOTP_LENGTH_MAX; size++) {
            connect_ends(BLOCKS[k], 0);
            for (size_t i = 0; i < size; i++)
                message[i] = (uint8_t)random_below(256);
            transfer(size, NO_DAMAGE, 0, 0xFFFFFF00u); /* the clock wraps on the way */
            const uint8_t *bytes = isotp_received(&b, &length);
            INVARIANT(bytes && length == size && memcmp(bytes, message, size) == 0);
            INVARIANT(a.sending.end == ISOTP_DONE && b.receiving.end == ISOTP_DONE);
            INVARIANT(a.count.sent == 1 && b.count.received == 1 && a.count.unexpected + b.count.unexpected == 0);
        }
    }
}

/* One lost, doubled or swapped frame: what is delivered is what was sent, or nothing; and the next one comes through.
 */
static void one_damaged_frame_delivers_nothing_wrong(void) {
    size_t length;
    for (int i = 0; i < DAMAGES; i++) {
        const size_t size = 1 + random_below(i % 2 ? 60 : ISOTP_LENGTH_MAX);
        const uint8_t block = (uint8_t)(i % 3 ? 8 : 0);
        connect_ends(block, 0);
        for (size_t j = 0; j < size; j++)
            message[j] = (uint8_t)random_below(256);
        const uint32_t frames = transfer(size, NO_DAMAGE, 0, 0);
        connect_ends(block, 0);
        transfer(size, (Damage)(1 + i % 3), random_below(frames), 0);
        const uint8_t *bytes = isotp_received(&b, &length);
        INVARIANT(!bytes || (length == size && memcmp(bytes, message, size) == 0));
        isotp_release(&b);
        transfer(size, NO_DAMAGE, 0, 100000);
        bytes = isotp_received(&b, &length);
        INVARIANT(bytes && length == size && memcmp(bytes, message, size) == 0);
    }
}

/* Consecutive frames keep at least STmin between them on a clock of whole milliseconds. */
static void separation_is_kept(void) {
    static const struct {
        uint8_t on_wire, ms;
    } CASES[] = {{0, 0}, {1, 1}, {20, 20}, {127, 127}, {0x80, 127}, {0xF1, 1}, {0xF9, 1}, {0xFA, 127}};
    for (size_t k = 0; k < sizeof CASES / sizeof *CASES; k++) {
        connect_ends(0, CASES[k].on_wire);
        INVARIANT(isotp_send(&a, message, 30));
        CanFrame frame;
        INVARIANT(isotp_next(&a, 0, &frame) && isotp_take(&b, &frame, 0));
        INVARIANT(isotp_next(&b, 0, &frame) && isotp_take(&a, &frame, 0));
        INVARIANT(isotp_next(&a, 5, &frame));
        const uint32_t earliest = 5u + CASES[k].ms + (CASES[k].ms > 0); /* the first one may have gone at 5.999 */
        INVARIANT(CASES[k].ms == 0 || !isotp_next(&a, earliest - 1, &frame));
        INVARIANT(isotp_next(&a, earliest, &frame));
    }
}

int main(void) {
    every_length_arrives();
    one_damaged_frame_delivers_nothing_wrong();
    separation_is_kept();
    return 0;
}
