#include "board.h"
#include "bytes.h"
#include "crc32.h"
#include "input.h"
#include "layer_order.h"

static void check_outputs(const FuzzBoard *board) {
    const Node *node = board->node;
    invariant(!node->journal.unread || node_is_off(node), "off while it is not known what was done");
    const uint32_t here = fuzz_board_lines(board);
    invariant(!node_is_off(node) || (!board->lamp && !board->gate && !board->working), "SAFE and FAULT are off");
    invariant(!board->lamp || ((here & LINE_GATE_CLOSED) && !(here & LINE_GATE_OPEN)),
              "lamp only with the gate closed");
    invariant(!board->lamp || fuzz_board_allows(board, ENABLE_LAMP), "lamp only while a living master allows it");
    invariant(!board->lamp || board->now - board->lamp_at < node->options.limits.lamp,
              "lamp never longer than its limit");
    invariant(!board->gate || fuzz_board_allows(board, ENABLE_GATE), "gate only while a living master allows it");
    const bool jets = board->working && board->work.kind == WORK_JET && !board->work.dry;
    invariant(!jets || ((here & LINE_GATE_OPEN) && !(here & (LINE_GATE_CLOSED | LINE_LAMP_ON))),
              "droplets fly only with gate open and lamp off");
    invariant(node_is_off(node) || board->now - board->alive_at < node->options.limits.alive,
              "off without a living master");
    invariant(!board->working || node->step.kind != STEP_NONE, "nothing works without a step");
    invariant((board->lamp || board->gate) <= (node->step.kind != STEP_NONE), "nothing is energised without a step");
}

static void check_progress(FuzzBoard *board) {
    const Node *node = board->node;
    const LayerProgress *progress = &node->progress, *before = &board->progress;
    const Jetted *jetted = &board->jetted;
    if (progress->layer == UINT16_MAX) /* a person gave up what could not be read */
        board->tampered = true;
    if (node->dry || board->tampered || node->journal.unread)
        return;
    const bool head = node_has(node, ROLE_HEAD);
    const uint8_t known = (uint8_t)(progress->done | progress->unknown);
    invariant(!(progress->done & progress->unknown), "a pass is done or unknown");
    const bool same = progress->job == jetted->job && progress->layer == jetted->layer;
    invariant(!head || !(progress->done & ~(same ? jetted->finished : 0)), "what is done was jetted to its end");
    if (same && head) {
        const uint8_t now = (uint8_t)(node->step.kind == STEP_PASS ? 1u << node->step.key.pass : 0u);
        invariant(!(jetted->opened & ~(known | now)), "what was jetted is done, unknown or under way");
    }
    if (board->progress_known && progress->job == before->job && progress->layer == before->layer)
        invariant(!(before->done & ~progress->done), "passes done never shrink");
    else if (board->progress_known && head)
        invariant(layer_is_finished(before) || layer_is_closed(before) || !layer_is_begun(before),
                  "no open layer is left");
    if (board->progress_known && progress->job == before->job && head)
        invariant(progress->layer >= before->layer, "layers go up");
    if (board->progress_known && progress->job != before->job) /* a node knows of one job */
        board->jetted = (Jetted){.job = progress->job};
    board->progress = *progress;
    board->progress_known = true;
}

static void check_journal(const FuzzBoard *board) {
    const Journal *journal = &board->node->journal;
    enum { MOST = FUZZ_STORAGE_BYTES / RECORD_BYTES };
    uint8_t records[MOST][RECORD_BYTES];
    const uint32_t found = journal_read(journal, records[0], MOST);
    invariant(found <= MOST, "as many records as asked for");
    uint32_t above = 0;
    for (uint32_t k = 0; k < found; k++) {
        invariant(get_u32(records[k] + RECORD_BYTES - 4) == crc32_after(0, records[k], RECORD_BYTES - 4),
                  "records are whole");
        invariant(board->tampered || k == 0 || get_u32(records[k]) < above, "newest first");
        above = get_u32(records[k]);
    }
    if (board->tampered || journal->newest.number == 0)
        return;
    invariant(found > 0 && get_u32(records[0]) == journal->newest.number, "the newest record can be read");
}

static bool is_cause(Cause cause) {
    static const uint32_t CAUSES = 1u << CAUSE_NONE | 1u << CAUSE_MASTER_LOST | 1u << CAUSE_STOP_REQUEST |
                                   1u << CAUSE_ENABLE_DROPPED | 1u << CAUSE_TWO_MASTERS | 1u << CAUSE_SUPERVISION |
                                   1u << CAUSE_STEP_EXPIRED | 1u << CAUSE_GATE_NOT_CONFIRMED | 1u << CAUSE_LAMP_TIME |
                                   1u << CAUSE_BACK_PRESSURE | 1u << CAUSE_STAGE_POSITION | 1u << CAUSE_SCAN_FAILED |
                                   1u << CAUSE_JOURNAL_DAMAGED | 1u << CAUSE_PASS_UNKNOWN | 1u << CAUSE_STORAGE_FAILED |
                                   1u << CAUSE_JOURNAL_UNREADABLE;
    return cause < 32 && (CAUSES >> cause & 1u);
}

void fuzz_board_check(FuzzBoard *board) {
    check_outputs(board);
    check_progress(board);
    if (board->written_to)
        check_journal(board);
    board->written_to = false;
    const NodeStatus status = node_status(board->node);
    invariant(status.state <= NODE_FAULT && is_cause(status.cause), "states and causes of the DBC");
    invariant(board->node->answer_length <= ANSWER_ROOM, "answers stay in their room");
    if (board->shows && (status.state != board->shown.state || status.cause != board->shown.cause))
        fprintf(stderr, "state %d cause %d\n", (int)status.state, (int)status.cause);
    board->shown = status;
}
