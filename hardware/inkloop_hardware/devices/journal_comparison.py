"""Comparison of the journals of the master and the head, before the first request to the head.

The head's journal decides which passes were jetted: a pass that is done or unknown there is so; a requested pass that
is not in it was never begun. Only one contradiction is possible: a step that the head has reported as done and no
longer knows.
"""

from __future__ import annotations

from inkloop_hardware.devices.master_journal import LayerAsked
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.protocol.node_state import Flags, NodeState

ADVICE = (
    "another head is mounted, its journal was erased, or something else was printed since; nothing is jetted on a part "
    "whose layers are not known: put the head of this job back and continue with `inkloop resume RUN`, or begin a new "
    "part with `inkloop run SCENARIO`"
)


class JournalsDiffer(HardwareError):
    """The journals of master and head, or the state of the run, cannot both be true: a person must find the cause."""

    has_own_remedy = True


def compare(mine: LayerAsked | None, job: int, head: NodeState) -> None:
    """Raise JournalsDiffer if the journal of the head contradicts that of the master.

    mine: the newest layer the master asked for, None for none; job: of the run; head: its state, with its newest layer.
    """
    if mine is None or head.flags & Flags.JOURNAL_UNREADABLE:  # `readiness.blocked` names the latter
        return
    begun, is_same_job = head.done | head.unknown, head.job == job
    ours = f"this run's journal: {_passes(mine.done)} of layer {mine.layer} of job {job} done"
    theirs = f"the head's: layer {head.layer} of job {head.job}, {_passes(head.done)} done"
    if head.unknown:
        theirs += f", {_passes(head.unknown)} unknown"
    differ = JournalsDiffer(f"head: the journals differ ({ours}; {theirs}): {ADVICE}")
    if is_same_job and head.layer == mine.layer:
        if mine.done & ~head.done or begun & ~mine.asked:
            raise differ
        if begun and head.pattern_crc != mine.pattern_crc:
            raise JournalsDiffer(
                f"head: layer {head.layer} was begun with another pattern (CRC-32 {head.pattern_crc:08x}) than this "
                f"run's journal has ({mine.pattern_crc:08x}): {ADVICE}"
            )
    elif mine.asked or (
        mine.layer > 1 and not (is_same_job and head.layer == mine.layer - 1)
    ):  # the head had confirmed the pattern of the layer before it was asked for a pass
        raise differ


def check_resumed_at(layer: int, mine: LayerAsked | None) -> None:
    """Raise JournalsDiffer if a layer is requested that the journal of this run has already passed."""
    if mine and mine.layer > layer:
        raise JournalsDiffer(
            f"layer {layer} is due, but this run has begun layer {mine.layer} already: its checkpoint is older than "
            "its journal, or is gone. Was the run folder restored from a copy, or its folder layers removed? A part "
            "lies on the stage: take it off, `inkloop bench clear SCENARIO --give-up`, and begin a new part in a new "
            "folder"
        )


def _passes(mask: int) -> str:
    numbers = [str(number + 1) for number in range(mask.bit_length()) if mask >> number & 1]
    if not numbers:
        return "no pass"
    return f"pass{'es' if len(numbers) > 1 else ''} {', '.join(numbers)}"
