#include "wire_faults.h"

#include <string.h>

#include "e2e.h"
#include "frame_faults.h"

void wire_faults_init(WireFaults *wire, Faults *faults, const WireEnds *ends) {
    memset(wire, 0, sizeof *wire);
    wire->faults = faults;
    wire->ends = *ends;
}

/* False when there is no room left: the frame is passed on at once. */
static bool hold(WireFaults *wire, Way way, const CanFrame *frame, const Fault *fault, uint32_t next) {
    for (int k = 0; k < HELD_FRAMES; k++) {
        if (wire->held[k].behind > 0)
            continue;
        wire->held[k] = (HeldFrame){.frame = *frame,
                                    .way = way,
                                    .behind = fault->frames + 1,
                                    .same_id = fault->kind == FAULT_TRANSMIT_ORDER,
                                    .next = next};
        return true;
    }
    return false;
}

static void garble(WireFaults *wire, Way way, const CanFrame *frame, const Fault *fault) {
    char line[2 * SLCAN_LINE_MAX];
    if (way == FROM_NODES) /* in the other direction the adapter drops such a line */
        wire->ends.line(wire->ends.context, line, frame_garble(frame, fault, line));
}

static void pass_on(WireFaults *wire, Way way, CanFrame frame, uint32_t next) {
    for (uint32_t k = next; k < wire->faults->count; k++) {
        Fault *fault = &wire->faults->fault[k];
        if (!fault_hits_frame(fault, way, &frame))
            continue;
        switch (fault->kind) {
        case FAULT_CORRUPTION:
            frame_corrupt(&frame, fault);
            break;
        case FAULT_DUPLICATION:
            pass_on(wire, way, frame, k + 1);
            break;
        case FAULT_SWAP:
        case FAULT_DELAY:
        case FAULT_TRANSMIT_ORDER:
            if (hold(wire, way, &frame, fault, k + 1))
                return;
            break;
        case FAULT_STUCK_COUNTER:
            frame_hold_counter(&frame, wire->counter[frame.id % STANDARD_IDS]);
            break;
        case FAULT_BAD_CHECK:
            frame_spoil_check(&frame);
            break;
        case FAULT_MALFORMED_LINE:
            garble(wire, way, &frame, fault);
            return;
        default: /* lost */
            return;
        }
    }
    if (frame.length > 1)
        wire->counter[frame.id % STANDARD_IDS] = e2e_counter(frame.data);
    wire->ends.frame(wire->ends.context, way, &frame);
}

void wire_faults_pass(WireFaults *wire, Way way, const CanFrame *frame) {
    pass_on(wire, way, *frame, 0);
    for (int k = 0; k < HELD_FRAMES; k++) {
        HeldFrame *held = &wire->held[k];
        const bool follows = held->way == way && (!held->same_id || held->frame.id == frame->id);
        if (follows && held->behind > 0 && --held->behind == 0)
            pass_on(wire, way, held->frame, held->next);
    }
}

void wire_faults_settle(WireFaults *wire) {
    for (int k = 0; k < HELD_FRAMES; k++) {
        HeldFrame *held = &wire->held[k];
        if (!held->same_id || held->behind == 0)
            continue;
        held->behind = 0;
        pass_on(wire, held->way, held->frame, held->next);
    }
}
