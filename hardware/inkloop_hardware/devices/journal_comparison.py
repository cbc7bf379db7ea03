"""Whether the journal of the master and that of the head can both be true, before anything is asked of the head.

The head's word counts for what was jetted: a pass that it calls done is done, one that it calls unknown is unknown, one
that it was asked for and does not know was never begun. What cannot be: it does not know what it has said was done.
"""

from __future__ import annotations

from inkloop_hardware.devices.master_journal import LayerAsked
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.protocol.node_state import NodeState

ADVICE = (
    "another head is mounted, its journal was erased, or something else was printed since; nothing is jetted on a part "
    "of which nobody knows the layers: put the head of this job back, or begin a new part with `inkloop run`"
)


class JournalsDiffer(HardwareError):
    """The master's journal and the head's cannot both be true: a person has to find out."""


def compare(mine: LayerAsked | None, job: int, head: NodeState) -> None:
    """Raises JournalsDiffer where the head says otherwise than the master, of the same job, remembers.

    mine: the newest layer the master asked for, None for none; job: of the run; head: its state, with what its journal
    holds of its newest layer.
    """
    if mine is None:
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
                f"run's journal says ({mine.pattern_crc:08x}): {ADVICE}"
            )
    elif mine.asked or (
        mine.layer > 1 and not (is_same_job and head.layer == mine.layer - 1)
    ):  # the head has told that it knows the layer's pattern, or it would not have been asked for a pass
        raise differ


def _passes(mask: int) -> str:
    numbers = [str(number + 1) for number in range(mask.bit_length()) if mask >> number & 1]
    if not numbers:
        return "no pass"
    return f"pass{'es' if len(numbers) > 1 else ''} {', '.join(numbers)}"
