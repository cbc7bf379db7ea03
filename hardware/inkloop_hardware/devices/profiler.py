"""Component kind `hardware.profiler`: a profile sensor over the stage on a CAN bus.

The first scan of a print is checked: whether the profiler sees the bed, and whether the bed is empty.
"""

from __future__ import annotations

from struct import Struct
from struct import error as StructError
from typing import Any

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job, Ports, Status, Values
from inkloop.contract import LAYERS_PRINTED, LAYERS_SCANNED, MEASURED_HEIGHT, STATUS, VALID, contract_ports
from inkloop.errors import ComponentError
from inkloop.units import UM_PER_M
from inkloop_hardware.devices.journal_comparison import check_resumed_at
from inkloop_hardware.devices.layer_steps import LayerSteps
from inkloop_hardware.devices.master_journal import MasterJournal
from inkloop_hardware.devices.readiness import make_ready, retry_after_recovery
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.transfer_bytes import read_map

HIGH_LAYERS = 3.0
"""Height above the plane of the bed from which on a cell carries something: more is no levelling (assumed)."""
HIGH_SHARE = 0.02
"""Share of cells that high from which on a part lies there: fewer are spikes of the sensor (assumed)."""
LOW = 0.05
"""Share of cells that are bed at least, and more than spikes (assumed)."""


class FirstScanError(HardwareError):
    """The first scan does not show an empty bed."""


def check_seen(valid: BoolMap, rig: Rig, what: str) -> None:
    """Raise FirstScanError if a scan has fewer valid cells than `rig.valid_share`; what: names it."""
    share = float(valid.mean())
    if share < rig.valid_share:
        raise FirstScanError(
            f"{what}: {share:.0%} of its cells are valid; needs {rig.valid_share:.0%} (bench.valid_share): is the "
            "profiler covered, off, out of its range, or not over the bed?"
        )


def check_first_scan(height: FloatMap, valid: BoolMap, job: Job, rig: Rig) -> None:
    """Raise FirstScanError if the profiler hardly sees the bed, or if a part lies on a bed that is to be empty.

    height, valid: (nx, ny) [m], of the first scan of a print. A job with a start surface of its own needs no empty bed,
    nor does one with `rig.on_part`.
    """
    check_seen(valid, rig, "the first scan")
    if rig.on_part or job.height_start is not None or not valid.any():
        return
    above = _above_bed(height, valid)
    layer = max(ink.layer_height for ink in job.inks)
    high = int(np.count_nonzero(above > HIGH_LAYERS * layer))
    if high > HIGH_SHARE * above.size:
        raise FirstScanError(
            f"the first scan shows something on the bed: {high} of {above.size} cells stand more than "
            f"{HIGH_LAYERS * layer * UM_PER_M:.0f} µm above it, the highest {above.max() * UM_PER_M:.0f} µm. Take it "
            "off; or print on it with `inkloop run SCENARIO --on-part`"
        )


def _above_bed(height: FloatMap, valid: BoolMap) -> FloatMap:
    """Heights of the valid cells above the bed [m]: a plane with the median slope of cells an eighth of the grid apart,
    below all but the lowest cells."""
    seen = np.where(valid, height, np.nan)
    rest = seen.copy()
    for axis, count in enumerate(height.shape):
        apart = max(1, count // 8)
        if count > apart:
            rises = np.take(seen, range(apart, count), axis) - np.take(seen, range(count - apart), axis)
            slope = np.nanmedian(rises) / apart if np.isfinite(rises).any() else 0.0
            rest -= slope * np.indices(height.shape)[axis]
    found: FloatMap = rest[valid]
    return found - np.quantile(found, LOW)


NODES = (Node.PROFILER, Node.STAGE)
_STATE = Struct(">Ii")  # job, layers scanned


class NewestScan:
    """The newest scan of a device. layer: -1 before the first; height: (nx, ny) [m], of a cell that it did not see the
    last measured one, at first 0; valid: the cells that it saw."""

    def __init__(self, job: Job) -> None:
        self.layer, self.height = -1, np.zeros((job.nx, job.ny))
        self.valid = np.zeros((job.nx, job.ny), np.bool_)

    def take(self, layer: int, height: FloatMap, valid: BoolMap, job: Job, rig: Rig) -> None:
        """Take a scan; FirstScanError, see `check_first_scan`."""
        if self.layer < 0:
            check_first_scan(height, valid, job, rig)
        self.layer, self.height, self.valid = layer, np.where(valid, height, self.height), valid

    def saved(self, state: Struct, *values: Any) -> bytes:
        """Bytes of a device: its values, its maps."""
        return state.pack(*values) + self.height.tobytes() + self.valid.tobytes()

    def restore(self, saved: bytes, state: Struct, what: str) -> tuple[Any, ...]:
        """Take the maps that were saved; the values. ComponentError for bytes not of a `what` of this grid."""
        shape = self.height.shape
        try:
            values = state.unpack_from(saved)
            height = np.frombuffer(saved, np.float64, self.height.size, state.size)
            valid = np.frombuffer(saved, np.bool_, self.valid.size, state.size + height.nbytes)
        except (StructError, ValueError) as error:
            raise ComponentError(f"the saved state is not one of this {what} ({error})") from error
        self.height, self.valid = height.reshape(shape).copy(), valid.reshape(shape).copy()
        return values


class Profiler:
    """Scans each new layer, the start surface first; a step with a new layer lasts until its map is transferred.

    It has no input `height`: it measures the real part. A cell that a scan did not see keeps its last measured height,
    at first 0. rig, journal: shared with the other devices.
    """

    is_device = True

    def __init__(self, job: Job, rig: Rig, *, journal: MasterJournal | None = None) -> None:
        self._job, self._rig = job, rig
        self._journal = journal or MasterJournal()
        ports = self.ports(job)
        self.inputs, self.outputs = ports.inputs, ports.outputs
        self._attached = False
        self._steps: LayerSteps | None = None
        self._scan = NewestScan(job)

    @classmethod
    def ports(cls, job: Job) -> Ports:
        """The ports of a profiler, which need no bus."""
        shape = (job.nx, job.ny)
        outputs = contract_ports(shape, MEASURED_HEIGHT, VALID, LAYERS_SCANNED, STATUS)
        return Ports(contract_ports(shape, LAYERS_PRINTED), outputs, is_device=cls.is_device)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Open the bus, check the nodes, clear them and home the stage. The first step makes the first scan."""
        self._journal.begin(self._rig)
        self._rig.attach()
        self._attached = True
        limits = retry_after_recovery(self._rig, NODES, lambda: make_ready(self._rig, NODES), is_start=True)
        self._steps = LayerSteps(self._rig, self._job, limits, journal=self._journal)
        self._scan.layer = -1
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Scan the new layer, if there is one."""
        self._rig.keep_alive()
        newest, steps = int(inputs[LAYERS_PRINTED]), self._steps
        if newest != self._scan.layer and steps is not None:
            check_resumed_at(newest, self._journal.layer)
            found = retry_after_recovery(self._rig, NODES, lambda: steps.scan(newest))
            self._scan.take(newest, *read_map(found, self._job.nx, self._job.ny), self._job, self._rig)
        return self._outputs()

    def terminate(self) -> None:
        """Leave the bus; the last device closes it."""
        if self._attached:
            self._attached = False
            self._rig.detach()

    def save(self) -> bytes:
        """Job, layer, heights and valid cells."""
        return self._scan.saved(_STATE, self._rig.job, self._scan.layer)

    def restore(self, saved: bytes) -> None:
        """Resume a job. ComponentError for a state that is not one of a profiler of this grid."""
        job, self._scan.layer = self._scan.restore(saved, _STATE, "profiler")
        self._journal.resume(self._rig, job)

    def _outputs(self) -> Values:
        return {
            MEASURED_HEIGHT: self._scan.height,
            VALID: self._scan.valid,
            LAYERS_SCANNED: np.asarray(self._scan.layer, np.int32),
            STATUS: np.asarray(int(Status.IDLE), np.int32),
        }
