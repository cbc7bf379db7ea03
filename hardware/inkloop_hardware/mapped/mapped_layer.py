"""The layers of a mapped rig: their steps, made one after the other on an open bus, and those that were begun before.

A mapped rig keeps no journal of its own. A layer of which a step was begun and that was not finished may lie on the
bed, or not, or in part: only a person can tell, and nothing is sent to the rig before. A person's stop is made by the
steps that a mapping has for it.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from udsoncan import MemoryLocation

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import ComponentError
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.devices.master_journal import Asked, Event, JournalError, MasterJournal
from inkloop_hardware.errors import HardwareError, LinkTimeout, TransferError
from inkloop_hardware.mapped.mapped_bus import MappedBus
from inkloop_hardware.mapped.mapped_bytes import hexadecimal, map_size, number, pattern_bytes, read_map
from inkloop_hardware.mapped.mapping_file import RigMapping, resolved
from inkloop_hardware.mapped.mapping_tables import Acting, Download, Memory, Read, RoutineStep, Send, Step, Upload, Wait
from inkloop_hardware.protocol.services import Key

LOG = logging.getLogger("inkloop_hardware")
POLL = 0.1
"""Seconds between two reads of an identifier."""

Record = Callable[[int, int], AbstractContextManager[None]]
"""Recorder of a step that acts: layer and number of the step."""


class MappedSteps:
    """Makes steps. pattern: (nx, ny), of downloads; scan: heights (nx, ny) [m] and valid cells of the last upload."""

    def __init__(self, bus: MappedBus, mapping: RigMapping, job_number: int) -> None:
        self._bus, self._tables, job = bus, mapping.tables, mapping.job
        self._fields = {"job": job_number, "nx": job.nx, "ny": job.ny}
        self.pattern: NDArray[np.int32] = np.zeros((job.nx, job.ny), np.int32)
        self.scan: tuple[FloatMap, BoolMap] = np.zeros((job.nx, job.ny)), np.zeros((job.nx, job.ny), np.bool_)

    def do(self, what: str, steps: Sequence[Step], layer: int, record: Record | None = None) -> None:
        """Make steps in order; `what` names them in log and errors. Raises HardwareError, ComponentError."""
        fields = {**self._fields, "layer": layer}
        for place, step in enumerate(steps, 1):
            LOG.info("%s: step %d of %d (%s)", what, place, len(steps), step.do)
            if not isinstance(step, Wait | Read):
                self._bus.forget()
            recorded = record(layer, place) if record and isinstance(step, Acting) and step.acts else nullcontext()
            with recorded, self._bus.enabled(step.enables):
                try:
                    self._one(step, fields)
                except ValueError as error:  # a template that was right for layer 1
                    raise ComponentError(f"{what}, step {place} ({step.do}): {error}; correct the mapping") from error

    def _one(self, step: Step, fields: dict[str, int]) -> None:
        bus = self._bus
        if isinstance(step, Download):
            self._download(step, fields)
        elif isinstance(step, Upload):
            self._upload(step, fields)
        elif isinstance(step, Send):
            bus.send(step.message, {name: resolved(value, fields) for name, value in step.signals.items()})
        elif isinstance(step, Wait):
            unless = None if step.unless is None else resolved(step.unless, fields)
            bus.wait(step.message, step.signal, resolved(step.expected, fields), step.limit_s, unless)
        elif isinstance(step, RoutineStep):
            found = bus.peer(step.peer).routine(step.routine, hexadecimal(step.option, fields), step.limit_s)
            expected = hexadecimal(step.answer, fields)
            if not found.startswith(expected):
                raise TransferError(
                    f"{bus.peer(step.peer).name} answers routine 0x{step.routine:04X} with "
                    f"{found.hex(' ') or 'nothing'}, expected {expected.hex(' ')}; check the rig before you continue"
                )
        elif isinstance(step, Read):
            self._read(step, number(step.expected, fields))

    def _download(self, step: Download, fields: dict[str, int]) -> None:
        table = self._tables.pattern
        assert table is not None  # the file is checked
        try:
            blob = pattern_bytes(self.pattern, table, fields)
        except ValueError as error:
            raise ComponentError(str(error)) from error
        self._bus.peer(step.peer).download(_place(step, len(blob), fields), blob, step.check == "crc32")

    def _upload(self, step: Upload, fields: dict[str, int]) -> None:
        table = self._tables.map
        assert table is not None  # the file is checked
        size = map_size(table, fields)
        data = self._bus.peer(step.peer).upload(_place(step, size, fields), size, step.check == "crc32")
        self.scan = read_map(data, table, fields)

    def _read(self, step: Read, expected: int) -> None:
        peer, until = self._bus.peer(step.peer), self._bus.now() + step.limit_s
        while True:
            data = peer.read(step.identifier)
            found = int.from_bytes(data[step.at : step.at + step.bytes], "big")
            if len(data) >= step.at + step.bytes and found == expected:
                return
            if self._bus.now() > until:
                raise LinkTimeout(
                    f"identifier 0x{step.identifier:04X} of {peer.name} was not {expected} within "
                    f"{step.limit_s:g} s; it is {data.hex(' ')}"
                )
            self._bus.sleep(POLL)


def _place(step: Memory, size: int, fields: dict[str, int]) -> MemoryLocation:
    address = number(step.address, fields)
    return MemoryLocation(address, size, address_format=8 * step.address_bytes, memorysize_format=8 * step.size_bytes)


def stop_rig(settings: BusSettings, mapping: RigMapping) -> Iterator[str]:
    """Make the `[[stop]]` steps of a mapping beside a print that may be running, and yield what was done.

    HardwareError if there are none, or if one fails; BusError if the adapter cannot be used.
    """
    steps = mapping.tables.stop
    if not steps:
        raise HardwareError(
            f"{mapping.path}: has no [[stop]] steps, so nothing was sent: use the hard-wired stop of the rig. Steps "
            "that stop it, such as a frame, can be added to the mapping"
        )
    session = 1 + secrets.randbelow(0xFFFF)
    with closing(MappedBus(replace(settings, traffic_log=None), None, mapping, session, 1, is_alone=False)) as bus:
        MappedSteps(bus, mapping, 1).do("stop", steps, 0)
    yield f"all {len(steps)} [[stop]] steps of {mapping.path.name} were made; look at the rig before you go on"


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
