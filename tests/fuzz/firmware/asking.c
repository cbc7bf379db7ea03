#include "asking.h"

#include <string.h>

#include "bytes.h"
#include "uds.h"

enum { ENDS_WITHIN = 300 }; /* ticks */

void bench_turn(Bench *bench, uint32_t milliseconds) {
    bench->board.now += milliseconds;
    node_tick(&bench->node, bench->board.now);
    fuzz_board_check(&bench->board);
}

void bench_send_alive(Bench *bench, const MasterAlive *master) {
    fuzz_board_master_alive(&bench->board, master);
    node_master_alive(&bench->node, bench->board.now, master);
    bench->alive_at = bench->board.now;
}

void bench_live(Bench *bench, int ticks) {
    for (int k = 0; k < ticks; k++) {
        if (bench->board.now - bench->alive_at >= ALIVE_EVERY)
            bench_send_alive(bench, &bench->master);
        bench_turn(bench, TICK);
    }
}

void bench_power_up(Bench *bench) {
    fuzz_board_power_off(&bench->board);
    bench->board.now += TICK;
    memset(bench->options.pattern_memory, 0xA5, bench->options.pattern_bytes);
    node_init(&bench->node, &bench->options, &bench->board.hal, bench->board.now);
    invariant(bench->node.state == NODE_SAFE || bench->node.state == NODE_FAULT, "every node wakes up off");
}

static void check_transfer(Bench *bench, const uint8_t *answer) {
    const bool upload = bench->node.transfer.upload;
    if (answer[0] == UDS_UPLOAD + UDS_POSITIVE)
        bench->upload_of = bench->board.scans;
    if (answer[0] == UDS_TRANSFER + UDS_POSITIVE && upload)
        invariant(bench->upload_of == bench->board.scans, "all blocks of a map are of one scan");
}

static void check_answer(Bench *bench, const uint8_t *request, const uint8_t *answer, size_t length) {
    invariant(length <= bench->room, "answers fit their room");
    if (length == 0) {
        invariant(request[0] == UDS_SESSION || request[0] == UDS_TESTER_PRESENT, "only these may be silent");
        return;
    }
    const bool refused = answer[0] == UDS_NEGATIVE;
    invariant(refused ? length == 3 && answer[1] == request[0] && answer[2] != UDS_OK
                      : answer[0] == (uint8_t)(request[0] + UDS_POSITIVE),
              "an answer belongs to its request");
    if (!refused)
        check_transfer(bench, answer);
    const bool known = answer[0] == UDS_ROUTINE_CONTROL + UDS_POSITIVE && answer[4] == OUTCOME_DONE_BEFORE;
    const Key key = length == 13 ? uds_key(answer + 5) : (Key){0}, seen = bench->board.seen;
    if (known && get_u16(answer + 2) == ROUTINE_SCAN && !bench->node.dry)
        invariant(key.job == seen.job && key.layer == seen.layer && key.attempt == seen.attempt,
                  "only a finished scan is done before");
}

void bench_forget(Bench *bench) {
    free(bench->request);
    free(bench->answer);
    bench->request = bench->answer = NULL;
}

/* The immediate answer goes to `first`. */
static void ask(Bench *bench, const uint8_t *bytes, size_t length, uint8_t first[ANSWER_ROOM]) {
    bench_forget(bench);
    bench->request = malloc(length ? length : 1);
    bench->answer = malloc(bench->room);
    memset(first, 0, ANSWER_ROOM);
    if (!bench->request || !bench->answer)
        return;
    memcpy(bench->request, bytes, length);
    const size_t answered =
        node_request(&bench->node, bench->board.now, bench->request, length, bench->answer, bench->room);
    if (length > 0)
        check_answer(bench, bench->request, bench->answer, answered);
    memcpy(first, bench->answer, answered < ANSWER_ROOM ? answered : ANSWER_ROOM);
}

static bool is_pending(const uint8_t *answer) {
    return answer[0] == UDS_NEGATIVE && answer[2] == UDS_PENDING;
}

bool bench_ask_once(Bench *bench, const uint8_t *request, size_t length) {
    uint8_t first[ANSWER_ROOM];
    ask(bench, request, length, first);
    return first[0] != 0 && first[0] != UDS_NEGATIVE;
}

void bench_ask_to_the_end(Bench *bench, const uint8_t *request, size_t length) {
    uint8_t first[ANSWER_ROOM];
    ask(bench, request, length, first);
    const bool busy = is_pending(first);
    for (int k = 0; k < ENDS_WITHIN && is_pending(first); k++) {
        bench_live(bench, 1);
        node_take_answer(&bench->node, first, sizeof first);
    }
    const bool done = first[0] == UDS_ROUTINE_CONTROL + UDS_POSITIVE && first[4] == OUTCOME_DONE;
    if (!busy || !done || request[1] != UDS_START || bench->node.dry)
        return;
    const uint32_t before = bench->board.jets + bench->board.scans;
    ask(bench, request, length, first);
    invariant(first[4] == OUTCOME_DONE_BEFORE, "a repeat of what is done is done before");
    invariant(bench->board.jets + bench->board.scans == before && bench->node.step.kind == STEP_NONE,
              "and does nothing");
}
