"""Component kind `hardware.printer`: print head, stage and cure lamp on a CAN bus."""

from __future__ import annotations

from struct import Struct
from struct import error as StructError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Job, Port, Ports, Status, Values
from inkloop.contract import (
    DROP_LEVEL,
    LAYER_COMMAND,
    LAYER_UNKNOWN,
    LAYERS_PRINTED,
    PATTERN,
    STATUS,
    checked_command,
    contract_ports,
    pass_colour,
)
from inkloop.errors import ComponentError
from inkloop_hardware.devices.journal_comparison import JournalsDiffer, check_resumed_at, compare
from inkloop_hardware.devices.layer_steps import ALL_COLOURS, LayerSteps, PrintedLayer
from inkloop_hardware.devices.master_journal import MasterJournal
from inkloop_hardware.devices.readiness import make_ready, retry_after_recovery
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.node_state import NodeLimits
from inkloop_hardware.protocol.records import Node

NODES = (Node.HEAD, Node.STAGE, Node.CURE)
_STATE = Struct(">IIQQ?")  # job, layers printed, droplets of material A and of B, whether the last layer is unknown


class Printer:
    """Prints by the layer contract; a step that commands a layer lasts until it is printed and cured.

    It has no output `height`: a real printer does not measure its part. `layer_unknown`: the last layer was abandoned
    midway, with an unknown part of it jetted; droplets are those of complete passes. rig, journal: shared with the
    other devices; cure_ms: light after each pass. The errors of its steps are `HardwareError`s.
    """

    is_device = True

    def __init__(self, job: Job, rig: Rig, *, cure_ms: int = 100, journal: MasterJournal | None = None) -> None:
        self._job, self._rig, self._cure_ms = job, rig, cure_ms
        self._journal = journal or MasterJournal()
        ports = self.ports(job)
        self.inputs, self.outputs = ports.inputs, ports.outputs
        self._attached = False
        self._steps: LayerSteps | None = None
        self._printed, self._is_unknown = 0, False
        self._droplets = [0, 0]

    @classmethod
    def ports(cls, job: Job) -> Ports:
        """The ports of a printer, which need no bus."""
        shape = (job.nx, job.ny)
        droplets = (Port(name, dtype="int32") for name in ("droplets_a", "droplets_b"))
        outputs = (
            *contract_ports(shape, LAYERS_PRINTED, STATUS),
            *droplets,
            *contract_ports(shape, LAYER_UNKNOWN),
        )
        return Ports(contract_ports(shape, PATTERN, DROP_LEVEL, LAYER_COMMAND), outputs, is_device=cls.is_device)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Open the bus, compare journals, clear nodes and home the stage; commands count from the present one."""
        self._journal.begin(self._rig)
        self._rig.attach()
        self._attached = True
        limits = retry_after_recovery(self._rig, NODES, self._ready, is_start=True)
        self._steps = LayerSteps(self._rig, self._job, limits, cure_ms=self._cure_ms, journal=self._journal)
        self._printed, self._droplets, self._is_unknown = int(inputs[LAYER_COMMAND]), [0, 0], False
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Print the commanded layer, if there is one. ComponentError for a wrong command or pattern."""
        self._rig.keep_alive()
        if self._steps is None:
            raise ComponentError("the bus is not open: initialize comes first")
        command, pattern = checked_command(inputs, self._printed), inputs[PATTERN]
        if command == self._printed + 1:
            if np.any(inputs[DROP_LEVEL][pattern != 0] != 1):
                raise ComponentError(
                    "drop_level is not 1 everywhere: this head jets one drop per cell; set drop_levels = 1"
                )
            self._print(self._steps, command, pattern)
        return self._outputs()

    def _ready(self) -> dict[Node, NodeLimits]:
        """Compare the journals, then make the nodes ready: no step is requested before the journals agree."""
        self._rig.wait_for(NODES)
        compare(self._journal.layer, self._rig.job, self._rig.link(Node.HEAD).state())
        return make_ready(self._rig, NODES)

    def _print(self, steps: LayerSteps, layer: int, pattern: NDArray[Any]) -> None:
        check_resumed_at(layer, self._journal.layer)
        try:
            printed = retry_after_recovery(self._rig, NODES, lambda: steps.print_layer(layer, pattern))
        except ValueError as error:
            raise ComponentError(str(error)) from error
        self._printed, self._is_unknown = layer, printed.is_unknown
        jetted = _jetted(pattern, printed)
        for material in range(2):
            self._droplets[material] += int(np.count_nonzero(jetted == material + 1))

    def terminate(self) -> None:
        """Leave the bus; the last device closes it."""
        if self._attached:
            self._attached = False
            self._rig.detach()

    def save(self) -> bytes:
        """Job, layer, droplets, and whether the layer is unknown."""
        return _STATE.pack(self._rig.job, self._printed, *self._droplets, self._is_unknown)

    def restore(self, saved: bytes) -> None:
        """Resume a job. JournalError, JournalsDiffer if journal or head are of another one, or of another layer."""
        try:
            job, printed, *droplets, is_unknown = _STATE.unpack(saved)
        except StructError as error:
            raise ComponentError(f"the saved state is not one of this printer ({error})") from error
        self._journal.resume(self._rig, job)
        head = self._rig.link(Node.HEAD).state()
        follows = head.job == job and head.layer in (printed, printed + 1)
        if not follows and printed > 0:
            raise JournalsDiffer(
                f"the head last had layer {head.layer} of job {head.job}, this run was at layer {printed} of job "
                f"{job}: something else was printed since, or another head is mounted; put the head of this job back "
                "and continue with `inkloop resume RUN`, or begin a new part with `inkloop run SCENARIO`"
            )
        self._printed, self._droplets, self._is_unknown = printed, droplets, is_unknown

    def _outputs(self) -> Values:
        values = (self._printed, Status.IDLE, *self._droplets, self._is_unknown)
        return {port.name: np.asarray(value, port.dtype) for port, value in zip(self.outputs, values, strict=True)}


def _jetted(pattern: NDArray[Any], printed: PrintedLayer) -> NDArray[Any]:
    """The droplets of a pattern (nx, ny) that are known to be jetted."""
    if ALL_COLOURS in printed.passes:
        return pattern
    i, j = np.indices(pattern.shape)
    return np.where(np.isin(pass_colour(i, j), printed.passes), pattern, 0)
