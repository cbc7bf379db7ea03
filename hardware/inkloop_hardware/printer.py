"""The kind `hardware.printer`: print head, stage and cure lamp on a CAN bus as a component of the loop."""

from __future__ import annotations

from struct import Struct
from struct import error as StructError

import numpy as np

from inkloop.component import Job, Port, Status, Values
from inkloop.errors import ComponentError
from inkloop_hardware.layer_steps import LayerSteps
from inkloop_hardware.readiness import make_ready
from inkloop_hardware.rig import Rig
from inkloop_hardware.vocabulary import Node

NODES = (Node.HEAD, Node.STAGE, Node.CURE)
_STATE = Struct(">IIQQ")  # job, layers printed, droplets of material A and of B


class Printer:
    """Prints by the layer contract; a step that commands a layer lasts until it is printed and cured.

    It knows no `height`: a real printer does not see its part. rig: shared with the other devices; cure_ms: light after
    each pass. The errors of its steps are `HardwareError`s.
    """

    is_device = True

    def __init__(self, job: Job, rig: Rig, *, cure_ms: int = 100) -> None:
        self._job, self._rig, self._cure_ms = job, rig, cure_ms
        shape = (job.nx, job.ny)
        self.inputs = (
            Port("pattern", shape=shape, dtype="int32"),
            Port("drop_level", shape=shape, dtype="int32", start=1),
            Port("layer_command", dtype="int32"),
        )
        counters = ("layers_printed", "status", "droplets_a", "droplets_b")
        self.outputs = tuple(Port(name, dtype="int32") for name in counters)
        self._attached = False
        self._steps: LayerSteps | None = None
        self._printed = 0
        self._droplets = [0, 0]

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Open the bus, look at the nodes, clear them and home the stage; commands count from the present one."""
        self._rig.attach()
        self._attached = True
        limits = make_ready(self._rig, NODES)
        self._steps = LayerSteps(self._rig, self._job, limits, cure_ms=self._cure_ms)
        self._printed, self._droplets = int(inputs["layer_command"]), [0, 0]
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Print the layer that is commanded, if one is. ComponentError for a command or a pattern out of order."""
        self._rig.alive()
        command, pattern = int(inputs["layer_command"]), inputs["pattern"]
        if command not in (self._printed, self._printed + 1) or self._steps is None:
            raise ComponentError(
                f"layer_command is {command} after layer {self._printed}; needs {self._printed} or {self._printed + 1}"
            )
        if command == self._printed + 1:
            if np.any(inputs["drop_level"][pattern != 0] != 1):
                raise ComponentError(
                    "drop_level is not 1 everywhere: this head jets one drop a cell; take drop_levels = 1"
                )
            try:
                self._steps.print_layer(command, pattern)
            except ValueError as error:
                raise ComponentError(str(error)) from error
            self._printed = command
            for material in range(2):
                self._droplets[material] += int(np.count_nonzero(pattern == material + 1))
        return self._outputs()

    def terminate(self) -> None:
        """Leave the bus; the last device closes it."""
        if self._attached:
            self._attached = False
            self._rig.detach()

    def save(self) -> bytes:
        """Job, layer and droplets: what the journal of the head is compared with."""
        return _STATE.pack(self._rig.job, self._printed, *self._droplets)

    def restore(self, saved: bytes) -> None:
        """Go on with a job. ComponentError where the head was used for something else since."""
        try:
            job, printed, *droplets = _STATE.unpack(saved)
        except StructError as error:
            raise ComponentError(f"what is to be restored is no state of this printer ({error})") from error
        self._rig.job = job
        head = self._rig.link(Node.HEAD).state()
        follows = head.job == job and head.layer in (printed, printed + 1)
        if not follows and printed > 0:
            raise ComponentError(
                f"the head last had layer {head.layer} of job {head.job}, this run was at layer {printed} of job "
                f"{job}: something else was printed since, or another head is mounted; run the scenario anew"
            )
        self._printed, self._droplets = printed, droplets

    def _outputs(self) -> Values:
        values = (self._printed, Status.IDLE, *self._droplets)
        return {port.name: np.asarray(int(value), np.int32) for port, value in zip(self.outputs, values, strict=True)}
