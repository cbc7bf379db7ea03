"""Component kind `hardware.mapped`: a rig with its own frames and services, bound to the contract by a mapping file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from struct import Struct
from zlib import crc32

import numpy as np

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
from inkloop_hardware.devices.profiler import NewestScan
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.mapped.mapped_bus import MappedBus
from inkloop_hardware.mapped.mapped_layer import MappedSteps, newest_layer, outcome_of
from inkloop_hardware.mapped.mapping_file import factor, load
from inkloop_hardware.mapped.mapping_tables import Step
from inkloop_hardware.protocol.services import Key

_STATE = Struct(">Iii?")  # job, layers printed, layers scanned, whether the last layer is unknown


class Mapped:
    """Printer, profiler or both, by the steps of the mapping; a step of the loop lasts until they are done.

    Steps of a layer that act are in the journal of the run before and after they are made. A layer that was begun and
    not finished is not continued: a person looks at it first (mapped_layer.py). `layer_unknown`: what became of the
    last layer is not known. mapping: path of the mapping file. Raises ScenarioError with every error of the file; the
    errors of its steps are `HardwareError`s.
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
        self._printed, self._is_unknown, self._pattern_crc = 0, False, 0
        self._newest = NewestScan(job)

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
        self._made = MappedSteps(self._bus, self._mapping, self._rig.job)
        self._printed, self._newest.layer = int(inputs.get(LAYER_COMMAND, np.asarray(0))), -1
        self._is_unknown = False
        self._do("start", self._mapping.tables.start, self._printed)
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Print the commanded layer, then scan the new one. ComponentError for a wrong command."""
        self._open.take()
        tables = self._mapping.tables
        if tables.profiler and self._newest.layer < 0:
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
        return self._newest.saved(_STATE, self._rig.job, self._printed, self._newest.layer, self._is_unknown)

    def restore(self, saved: bytes) -> None:
        """Resume after a layer; the rig must still hold it. ComponentError for an invalid state."""
        job, self._printed, self._newest.layer, self._is_unknown = self._newest.restore(saved, _STATE, "rig")
        self._journal.resume(self._rig, job)

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
        self._made.pattern, self._pattern_crc = np.asarray(pattern), crc32(np.asarray(pattern, "<i4").tobytes())
        outcome = outcome_of(command, self._pattern_crc, newest_layer(self._journal), steps)
        if outcome is None:
            self._do(f"layer {command}", steps, command, is_layer=True)
            self._journal.done(Asked.LAYER, Key(self._rig.job, command), self._pattern_crc)
        self._printed, self._is_unknown = command, outcome is Event.UNKNOWN

    def _scan(self, newest: int) -> None:
        if newest != self._newest.layer:
            self._do(f"scan of layer {newest}", self._mapping.tables.profiler, newest)
            self._newest.take(newest, *self._made.scan, self._job, self._rig)

    def _do(self, what: str, steps: Sequence[Step], layer: int, *, is_layer: bool = False) -> None:
        """Make steps in order; is_layer: the journal records those that act."""
        self._open.take()
        self._made.do(what, steps, layer, self._recorded if is_layer else None)

    @contextmanager
    def _recorded(self, layer: int, place: int) -> Iterator[None]:
        """Record a step before and after it is made."""
        key = Key(self._rig.job, layer, place)
        self._journal.intend(Asked.STEP, key, self._pattern_crc)
        yield
        self._journal.done(Asked.STEP, key, self._pattern_crc)

    def _outputs(self) -> Values:
        values: dict[str, np.ndarray | float] = {
            STATUS: Status.IDLE,
            LAYERS_PRINTED: self._printed,
            LAYER_UNKNOWN: self._is_unknown,
            MEASURED_HEIGHT: self._newest.height.copy(),
            VALID: self._newest.valid.copy(),
            LAYERS_SCANNED: self._newest.layer,
        }
        for name, output in self._mapping.tables.outputs.items():
            reading = self._bus.readings.get(output.message) if self._bus else None
            signal = self._mapping.codec.message(output.message).get_signal_by_name(output.signal)
            found = math.nan if reading is None else reading.values.get(output.signal, math.nan)
            values[name] = found * (factor(signal.unit or "1", self._unit(name)) or 1.0)
        return {port.name: np.asarray(values[port.name], port.dtype) for port in self.outputs}
