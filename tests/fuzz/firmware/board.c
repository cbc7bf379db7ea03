#include "board.h"

#include <string.h>

#include "input.h"

static bool is_broken(const FuzzBoard *board, uint8_t what) {
    return (board->broken & what) != 0;
}

static bool storage_read(void *context, uint32_t offset, uint8_t *to, uint32_t length) {
    const FuzzBoard *board = context;
    invariant(offset <= FUZZ_STORAGE_BYTES && length <= FUZZ_STORAGE_BYTES - offset, "reads stay in the storage");
    if (board->blind_from > 0 && offset >= board->blind_from)
        return false;
    memcpy(to, board->storage + offset, length);
    return true;
}

/* Number of the `length` bytes that go through before the power fails. */
static uint32_t through(FuzzBoard *board, uint32_t length) {
    return board->power_fails && board->written < length ? board->written : length;
}

static void fail_if_due(FuzzBoard *board) {
    if (!board->power_fails)
        return;
    board->power_fails = false;
    longjmp(board->power_failure, 1);
}

static bool storage_write(void *context, uint32_t offset, const uint8_t *from, uint32_t length) {
    FuzzBoard *board = context;
    invariant(offset <= FUZZ_STORAGE_BYTES && length <= FUZZ_STORAGE_BYTES - offset, "writes stay in the storage");
    invariant(offset % board->hal.write_unit == 0 && length % board->hal.write_unit == 0, "whole words are written");
    invariant(!board->lamp && !board->gate, "nothing is energised while the flash is busy");
    board->written_to = true;
    if (is_broken(board, BROKEN_STORAGE)) /* it reports success and stores nothing */
        return true;
    const uint32_t written = through(board, length);
    for (uint32_t k = 0; k < written; k++) {
        invariant(board->tampered || board->storage[offset + k] == 0xFF, "only erased bytes are written");
        board->storage[offset + k] &= from[k];
    }
    fail_if_due(board);
    return true;
}

static bool storage_erase(void *context, uint32_t sector) {
    FuzzBoard *board = context;
    invariant(sector < board->hal.sectors, "erasures stay in the storage");
    if (is_broken(board, BROKEN_STORAGE))
        return false;
    board->written_to = true;
    memset(board->storage + sector * FUZZ_SECTOR_BYTES, 0xFF, through(board, FUZZ_SECTOR_BYTES));
    fail_if_due(board);
    return true;
}

uint32_t fuzz_board_lines(const FuzzBoard *board) {
    const bool there = board->now - board->gate_at >= FUZZ_GATE_MS;
    const bool stays_open = is_broken(board, BROKEN_GATE_STAYS_OPEN); /* both: the end switches contradict each other */
    const bool stays_closed = is_broken(board, BROKEN_GATE_STAYS_CLOSED);
    const bool open = stays_open || (!stays_closed && board->gate && there);
    const bool closed = stays_closed || (!stays_open && !board->gate && there);
    const bool lamp = board->lamp || is_broken(board, BROKEN_LAMP_STAYS_ON);
    const bool ready = !is_broken(board, BROKEN_NOT_READY);
    return (uint32_t)((open ? LINE_GATE_OPEN : 0) | (closed ? LINE_GATE_CLOSED : 0) | (lamp ? LINE_LAMP_ON : 0) |
                      (ready ? LINE_READY : 0) | (board->homed ? LINE_HOMED : 0));
}

static uint32_t lines(void *context) {
    return fuzz_board_lines(context);
}

bool fuzz_board_allows(const FuzzBoard *board, uint8_t enable) {
    const int which = enable == ENABLE_LAMP ? 0 : enable == ENABLE_GATE ? 1 : 2;
    return board->enabled[which] && board->now - board->enabled_at[which] < board->node->options.limits.alive;
}

static void set_lamp(void *context, bool on) {
    FuzzBoard *board = context;
    const uint32_t gate = lines(board) & (LINE_GATE_OPEN | LINE_GATE_CLOSED);
    invariant(!on || (gate == LINE_GATE_CLOSED && !board->gate), "lamp on only with the gate confirmed closed");
    invariant(!on || fuzz_board_allows(board, ENABLE_LAMP), "lamp on only when a living master allows it");
    invariant(!on || !board->node->dry, "no lamp in a dry run");
    if (on && !board->lamp)
        board->lamp_at = board->now;
    board->lamp = on;
}

static void set_gate(void *context, bool open) {
    FuzzBoard *board = context;
    invariant(!open || !(lines(board) & LINE_LAMP_ON), "gate open only with the lamp off");
    invariant(!open || fuzz_board_allows(board, ENABLE_GATE), "gate open only when a living master allows it");
    invariant(!open || !board->node->dry, "no gate in a dry run");
    if (open != board->gate)
        board->gate_at = board->now;
    board->gate = open;
}

/* A pass is jetted once and in its turn. */
static void note_jetting(FuzzBoard *board, const Work *work) {
    const Key *key = &board->node->step.key;
    const uint8_t bit = (uint8_t)(1u << key->pass);
    const uint32_t here = lines(board);
    invariant((here & LINE_GATE_OPEN) && !(here & LINE_LAMP_ON), "jetting only with the gate open and the lamp off");
    invariant(pattern_is_complete(work->pattern) && pattern_is_printable(work->pattern),
              "jetting a whole pattern only");
    invariant(work->colour < 4 ? work->pattern->passes == 4 : work->colour == 255 && work->pattern->passes == 1,
              "colours");
    board->jets++;
    if (board->tampered)
        return;
    if (board->jetted.job != key->job || board->jetted.layer != key->layer)
        board->jetted = (Jetted){.job = key->job, .layer = key->layer};
    invariant(!(board->jetted.opened & bit), "no pass is opened twice");
    invariant(board->jetted.finished == bit - 1, "no pass is left out");
    board->jetted.opened |= bit;
}

static bool begin(void *context, const Work *work) {
    FuzzBoard *board = context;
    const bool moves = work->kind == WORK_HOME || work->kind == WORK_MOVE;
    invariant(!moves || fuzz_board_allows(board, ENABLE_MOTION), "motion only when a living master allows it");
    invariant(!board->working, "one thing at a time");
    if (is_broken(board, BROKEN_BEGIN_REFUSED))
        return false;
    if (work->kind == WORK_JET && !work->dry)
        note_jetting(board, work);
    board->work = *work;
    board->working = true;
    board->work_at = board->now;
    return true;
}

static WorkProgress progress(void *context) {
    FuzzBoard *board = context;
    if (!board->working || is_broken(board, BROKEN_WORK_FAILS))
        return WORK_FAILED;
    if (is_broken(board, BROKEN_WORK_HANGS) || board->now - board->work_at < FUZZ_WORK_MS)
        return WORK_RUNNING;
    board->working = false;
    if (board->work.kind == WORK_HOME)
        board->homed = true;
    if (board->work.kind == WORK_SCAN) {
        board->scans++;
        board->seen = board->node->step.key;
    }
    if (board->work.kind == WORK_JET && !board->work.dry)
        board->jetted.finished |= (uint8_t)(1u << board->node->step.key.pass);
    return is_broken(board, BROKEN_STORAGE) ? WORK_NOT_STORED : WORK_FINISHED;
}

static void kick(void *context) {
    const FuzzBoard *board = context;
    invariant(!(board->lamp && board->gate), "no kick while the lamp lights the nozzles");
    invariant(!node_is_off(board->node) || (!board->lamp && !board->gate), "no kick while SAFE drives anything");
}

static void halt(void *context) {
    ((FuzzBoard *)context)->working = false;
}

static MapShape map_shape(void *context) {
    const FuzzBoard *board = context;
    return (MapShape){.nx = 3, .ny = 5, .lsb_nm = 100, .datum = (int32_t)board->scans};
}

static bool map_reading(void *context, uint32_t cell, int16_t *reading) {
    const FuzzBoard *board = context;
    invariant(cell < 15, "readings of cells of the map");
    *reading = (int16_t)(cell * 1000 + board->scans % 1000);
    return cell % 4 != 3;
}

void fuzz_board_init(FuzzBoard *board, Node *node, uint8_t sectors) {
    *board = (FuzzBoard){.node = node, .shows = getenv("INKLOOP_FUZZ_SHOWS") != NULL};
    memset(board->storage, 0xFF, sizeof board->storage);
    board->hal = (Hal){.context = board,
                       .sectors = sectors,
                       .sector_bytes = FUZZ_SECTOR_BYTES,
                       .write_unit = FUZZ_WRITE_UNIT,
                       .storage_read = storage_read,
                       .storage_write = storage_write,
                       .storage_erase = storage_erase,
                       .set_lamp = set_lamp,
                       .set_gate = set_gate,
                       .lines = lines,
                       .kick = kick,
                       .begin = begin,
                       .progress = progress,
                       .halt = halt,
                       .map_shape = map_shape,
                       .map_reading = map_reading};
}

void fuzz_board_power_off(FuzzBoard *board) {
    board->lamp = board->gate = board->working = board->homed = board->power_fails = false;
    for (int k = 0; k < 3; k++)
        board->enabled[k] = false;
    board->progress_known = false;
}

void fuzz_board_master_alive(FuzzBoard *board, const MasterAlive *master) {
    board->alive_at = board->now;
    for (int k = 0; k < 3; k++) {
        board->enabled[k] = (master->enables >> k & 1) != 0;
        if (board->enabled[k])
            board->enabled_at[k] = board->now;
    }
}

NodeOptions fuzz_options(uint8_t roles, uint8_t *pattern_memory) {
    NodeOptions options = {.roles = roles & 0xF, .limits = NODE_LIMITS};
    options.pattern_memory = pattern_memory;
    options.pattern_bytes = FUZZ_PATTERN_BYTES;
    options.limits.lamp = 200;
    options.limits.pass = options.limits.motion = options.limits.scan = 1000;
    options.limits.pending = 40;
    return options;
}
