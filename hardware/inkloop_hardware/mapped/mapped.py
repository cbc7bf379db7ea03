"""Component kind `hardware.mapped`: a rig with its own frames and services, bound to the contract by a mapping file."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from struct import Struct
from struct import error as StructError
from zlib import crc32

import numpy as np
from udsoncan import MemoryLocation

from inkloop.component import Job, Port, Status, Values
from inkloop.contract import (
    LAYER_COMMAND,
    LAYER_UNKNOWN,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    MEASURED_HEIGHT,
    PATTERN,
    STATUS,
    VALID,
    checked_command,
    contract_ports,
)
from inkloop.errors import ComponentError
from inkloop_hardware.devices.master_journal import Asked, Event, MasterJournal
from inkloop_hardware.errors import LinkTimeout, TransferError
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.mapped.mapped_bus import MappedBus
from inkloop_hardware.mapped.mapped_bytes import hexadecimal, map_size, number, pattern_bytes, read_map
from inkloop_hardware.mapped.mapping_file import factor, load, resolved
from inkloop_hardware.mapped.mapping_tables import Acting, Download, Memory, Read, RoutineStep, Send, Step, Upload, Wait
from inkloop_hardware.mapped.open_layer import newest_layer, outcome_of
from inkloop_hardware.protocol.services import Key

LOG = logging.getLogger("inkloop_hardware")
POLL = 0.1
"""Seconds between two reads of an identifier."""
_STATE = Struct(">Iii?")  # job, layers printed, layers scanned, whether the last layer is unknown


class Mapped:
    """Printer, profiler or both, by the steps of the mapping; a step of the loop lasts until they are done.

    Steps of a layer that act are in the journal of the run before and after they are made. A layer that was begun and
    not finished is not continued: a person looks at it first (open_layer.py). `layer_unknown`: what became of the last
    layer is not known. mapping: path of the mapping file. Raises ScenarioError with every error of the file; the errors
    of its steps are `HardwareError`s.
    """

    is_device = True

    def __init__(self, job: Job, *, mapping: str) -> None:
        self._job, self._mapping = job, load(Path(mapping), job)
        tables, shape = self._mapping.tables, (job.nx, job.ny)
        self.inputs: tuple[Port, ...] = ()
        self.outputs: tuple[Port, ...] = contract_ports(shape, STATUS)
        if tables.printer:
            self.inputs += contract_ports(shape, PATTERN, LAYER_COMMAND)
            self.outputs += contract_ports(shape, LAYERS_PRINTED, LAYER_UNKNOWN)
        if tables.profiler:
            self.inputs += () if tables.printer else contract_ports(shape, LAYERS_PRINTED)
            self.outputs += contract_ports(shape, MEASURED_HEIGHT, VALID, LAYERS_SCANNED)
        self.outputs += tuple(Port(name, self._unit(name), start=math.nan) for name in tables.outputs)
        self._bus: MappedBus | None = None
        self._journal = MasterJournal()
        self._printed, self._scanned, self._is_unknown = 0, -1, False
        self._height, self._valid = np.zeros(shape), np.zeros(shape, np.bool_)
        self._pattern, self._pattern_crc = np.zeros(shape, np.int32), 0

    def use_rig(self, rig: Rig) -> None:
        """Take the settings of the bus, its folder and the print job from this rig."""
        self._rig = rig

    def use_journal(self, journal: MasterJournal) -> None:
        """Take the journal of the run."""
        self._journal = journal

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Open the bus and make the steps of the start; commands count from the present one."""
        self._journal.begin(self._rig)
        self._bus = MappedBus(self._rig.settings, self._rig.folder, self._mapping, self._rig.session, self._rig.job)
        self._printed, self._scanned = int(inputs.get(LAYER_COMMAND, np.asarray(0))), -1
        self._is_unknown = False
        self._do("start", self._mapping.tables.start, self._printed)
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Print the commanded layer, then scan the new one. ComponentError for a wrong command."""
        self._open.take()
        tables = self._mapping.tables
        if tables.profiler and self._scanned < 0:
            self._scan(int(inputs.get(LAYERS_PRINTED, np.asarray(self._printed))))
        if tables.printer:
            self._print(checked_command(inputs, self._printed), inputs[PATTERN])
        if tables.profiler:
            self._scan(int(inputs.get(LAYERS_PRINTED, np.asarray(self._printed))))
        return self._outputs()

    def terminate(self) -> None:
        """Release the adapter."""
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()

    def save(self) -> bytes:
        """Job, counters, and the last map."""
        state = _STATE.pack(self._rig.job, self._printed, self._scanned, self._is_unknown)
        return state + self._height.tobytes() + self._valid.tobytes()

    def restore(self, saved: bytes) -> None:
        """Resume after a layer; the rig must still hold it. ComponentError for an invalid state."""
        cells = self._height.size
        try:
            job, printed, scanned, is_unknown = _STATE.unpack_from(saved)
            height = np.frombuffer(saved, np.float64, cells, _STATE.size)
            valid = np.frombuffer(saved, np.bool_, cells, _STATE.size + height.nbytes)
        except (StructError, ValueError) as error:
            raise ComponentError(f"the saved state is not one of this rig ({error})") from error
        self._journal.resume(self._rig, job)
        self._printed, self._scanned, self._is_unknown = printed, scanned, is_unknown
        self._height, self._valid = height.reshape(self._height.shape).copy(), valid.reshape(self._valid.shape).copy()

    @property
    def _open(self) -> MappedBus:
        if self._bus is None:
            raise ComponentError("the bus is not open: call initialize first")
        return self._bus

    def _unit(self, name: str) -> str:
        output = self._mapping.tables.outputs[name]
        signal = self._mapping.codec.message(output.message).get_signal_by_name(output.signal)
        return output.unit or signal.unit or "1"

    def _print(self, command: int, pattern: np.ndarray) -> None:
        if command != self._printed + 1:
            return
        steps = self._mapping.tables.printer
        self._pattern, self._pattern_crc = np.asarray(pattern), crc32(np.asarray(pattern, "<i4").tobytes())
        outcome = outcome_of(command, self._pattern_crc, newest_layer(self._journal), steps)
        if outcome is None:
            self._do(f"layer {command}", steps, command, is_layer=True)
            self._journal.done(Asked.LAYER, Key(self._rig.job, command), self._pattern_crc)
        self._printed, self._is_unknown = command, outcome is Event.UNKNOWN

    def _scan(self, newest: int) -> None:
        if newest != self._scanned:
            self._do(f"scan of layer {newest}", self._mapping.tables.profiler, newest)
            self._scanned = newest

    def _do(self, what: str, steps: Sequence[Step], layer: int, *, is_layer: bool = False) -> None:
        """Make steps in order; `what` names them in log and errors; is_layer: the journal records those that act."""
        fields = {"job": self._rig.job, "layer": layer, "nx": self._job.nx, "ny": self._job.ny}
        for place, step in enumerate(steps, 1):
            LOG.info("%s: step %d of %d (%s)", what, place, len(steps), step.do)
            if not isinstance(step, Wait | Read):
                self._open.forget()
            is_recorded = is_layer and isinstance(step, Acting) and step.acts
            with self._recorded(Key(self._rig.job, layer, place), is_recorded), self._open.enabled(step.enables):
                try:
                    self._one(step, fields)
                except ValueError as error:  # a template that was right for layer 1
                    raise ComponentError(f"{what}, step {place} ({step.do}): {error}; correct the mapping") from error

    @contextmanager
    def _recorded(self, key: Key, is_recorded: bool) -> Iterator[None]:
        """Record a step before and after it is made."""
        if is_recorded:
            self._journal.intend(Asked.STEP, key, self._pattern_crc)
        yield
        if is_recorded:
            self._journal.done(Asked.STEP, key, self._pattern_crc)

    def _one(self, step: Step, fields: dict[str, int]) -> None:
        bus = self._open
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
        table = self._mapping.tables.pattern
        assert table is not None  # the file is checked
        try:
            blob = pattern_bytes(self._pattern, table, fields)
        except ValueError as error:
            raise ComponentError(str(error)) from error
        self._open.peer(step.peer).download(_place(step, len(blob), fields), blob, step.check == "crc32")

    def _upload(self, step: Upload, fields: dict[str, int]) -> None:
        table = self._mapping.tables.map
        assert table is not None  # the file is checked
        size = map_size(table, fields)
        data = self._open.peer(step.peer).upload(_place(step, size, fields), size, step.check == "crc32")
        height, valid = read_map(data, table, fields)
        self._height, self._valid = np.where(valid, height, self._height), valid

    def _read(self, step: Read, expected: int) -> None:
        peer, until = self._open.peer(step.peer), time.monotonic() + step.limit_s
        while True:
            data = peer.read(step.identifier)
            found = int.from_bytes(data[step.at : step.at + step.bytes], "big")
            if len(data) >= step.at + step.bytes and found == expected:
                return
            if time.monotonic() > until:
                raise LinkTimeout(
                    f"identifier 0x{step.identifier:04X} of {peer.name} was not {expected} within "
                    f"{step.limit_s:g} s; it is {data.hex(' ')}"
                )
            time.sleep(POLL)

    def _outputs(self) -> Values:
        values: dict[str, np.ndarray | float] = {
            STATUS: Status.IDLE,
            LAYERS_PRINTED: self._printed,
            LAYER_UNKNOWN: self._is_unknown,
            MEASURED_HEIGHT: self._height.copy(),
            VALID: self._valid.copy(),
            LAYERS_SCANNED: self._scanned,
        }
        for name, output in self._mapping.tables.outputs.items():
            reading = self._bus.readings.get(output.message) if self._bus else None
            signal = self._mapping.codec.message(output.message).get_signal_by_name(output.signal)
            found = math.nan if reading is None else reading.values.get(output.signal, math.nan)
            values[name] = found * (factor(signal.unit or "1", self._unit(name)) or 1.0)
        return {port.name: np.asarray(values[port.name], port.dtype) for port in self.outputs}


def _place(step: Memory, size: int, fields: dict[str, int]) -> MemoryLocation:
    address = number(step.address, fields)
    return MemoryLocation(address, size, address_format=8 * step.address_bytes, memorysize_format=8 * step.size_bytes)
