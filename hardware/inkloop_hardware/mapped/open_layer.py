"""Layers of a mapped rig that were begun before: what the journal of the run knows of them.

A mapped rig keeps no journal of its own. A layer of which a step was begun and that was not finished may lie on the
bed, or not, or in part: only a person can tell, and nothing is sent to the rig before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from inkloop_hardware.devices.master_journal import Asked, Event, JournalError, MasterJournal
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.mapped.mapping_tables import Download, RoutineStep, Send, Step
from inkloop_hardware.protocol.services import Key


@dataclass(frozen=True)
class MappedLayer:
    """A layer of a mapped rig. step: number of the last one that was begun; outcome: INTENT while it is open;
    pattern_crc: CRC-32 of its pattern."""

    layer: int
    step: int
    outcome: Event
    pattern_crc: int


class LayerIsOpen(HardwareError):
    """A layer was begun and not finished, or with another pattern: a person must look at it."""

    has_own_remedy = True


def newest_layer(journal: MasterJournal) -> MappedLayer | None:
    """The newest layer that the rig was asked for in the job of a journal; None before the first."""
    found: MappedLayer | None = None
    for record in journal.records:
        if record.asked not in (Asked.STEP, Asked.LAYER) or record.key.job != journal.job:
            continue
        outcome = record.event if record.asked is Asked.LAYER else Event.INTENT
        step = record.key.pass_ if record.asked is Asked.STEP else found.step if found else 0
        found = MappedLayer(record.key.layer, step, outcome, record.pattern_crc)
    return found


def settle(folder: Path, layer_is: str) -> None:
    """Write into the journal of a run what a person has seen of its open layer: "printed", "blank" or "unknown".

    JournalError if no layer is open.
    """
    journal = MasterJournal(folder)
    known = newest_layer(journal)
    if journal.job is None or known is None or known.outcome is not Event.INTENT:
        raise JournalError(f"{folder}: no layer is open, there is nothing to say of one; leave --layer-is out")
    journal.settle(Event(layer_is), Key(journal.job, known.layer), known.pattern_crc)


def outcome_of(layer: int, pattern_crc: int, known: MappedLayer | None, steps: Sequence[Step]) -> Event | None:
    """Outcome of a layer that is due, by what the journal holds of the newest one: None, it is to be printed; DONE or
    PRINTED; UNKNOWN.

    pattern_crc: CRC-32 of the pattern that is due; steps: those of a layer. Raises LayerIsOpen.
    """
    if known is None or known.layer < layer:
        return None
    if known.layer > layer:
        raise LayerIsOpen(
            f"layer {layer} is due, but this run has begun layer {known.layer} already: its checkpoint is older than "
            "its journal, or is gone. Was the run folder restored from a copy? A part lies on the bed: take it off, "
            "and begin a new part in a new folder"
        )
    if known.outcome is Event.INTENT:
        raise LayerIsOpen(
            f"layer {layer} was begun and not finished: the last step begun is {known.step} of {len(steps)}"
            f"{_named(steps, known.step)}. The rig keeps no journal, so a person must say what became of the layer. "
            "Look at the part, then continue with `inkloop resume RUN --layer-is printed` (all of it lies there), "
            "`blank` (nothing of it: it is printed again) or `unknown` (some of it: the next scan shows what)"
        )
    if known.outcome is Event.BLANK:
        return None
    if known.pattern_crc != pattern_crc:
        raise LayerIsOpen(
            f"layer {layer} was printed with another pattern (CRC-32 {known.pattern_crc:08x}) than the one due now "
            f"({pattern_crc:08x}): was the run folder changed? Take the part off, and begin a new one in a new folder"
        )
    return known.outcome


def _named(steps: Sequence[Step], number: int) -> str:
    """Name of the step of this number, in brackets."""
    if not 1 <= number <= len(steps):  # the mapping was changed since
        return ""
    step = steps[number - 1]
    what = {Send: "message", RoutineStep: "peer", Download: "peer"}.get(type(step))
    return f" ({step.do} {getattr(step, what)})" if what else f" ({step.do})"
