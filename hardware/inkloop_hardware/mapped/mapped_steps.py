"""The steps of a mapping, made one after the other on an open bus; a person's stop by those it has for it."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from udsoncan import MemoryLocation

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import ComponentError
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import HardwareError, LinkTimeout, TransferError
from inkloop_hardware.mapped.mapped_bus import MappedBus
from inkloop_hardware.mapped.mapped_bytes import hexadecimal, map_size, number, pattern_bytes, read_map
from inkloop_hardware.mapped.mapping_file import RigMapping, resolved
from inkloop_hardware.mapped.mapping_tables import Acting, Download, Memory, Read, RoutineStep, Send, Step, Upload, Wait

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
