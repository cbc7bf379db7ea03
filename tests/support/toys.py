"""Small Python components for tests: one made of functions, and three that keep the layer contract."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from inkloop.component import Job, Port, Status, Values
from inkloop.contract import contract_ports
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.master.master import Master
from inkloop.results.recorder import Recorder
from inkloop.results.result import Result

DROPLET = 10e-6
"""Height that a toy droplet adds to its cell [m]."""


def toy_job(nx: int = 4, ny: int = 3, layers: int = 5) -> Job:
    """A block of `layers` toy droplets, one cell row of margin along x."""
    mask = np.zeros((nx, ny), dtype=np.bool_)
    mask[1:-1] = True
    return Job(nx, ny, 1e-4, np.where(mask, layers * DROPLET, 0.0), mask)


class FunctionComponent:
    """A component made of functions; `log` collects what was called."""

    def __init__(
        self,
        inputs: Sequence[Port] = (),
        outputs: Sequence[Port] = (),
        step: Callable[[int, int, Values], Values] | None = None,
        start: Callable[[Values], Values] | None = None,
    ) -> None:
        self.inputs = tuple(inputs)
        self.outputs = tuple(outputs)
        self._step = step or (lambda time_ns, step_ns, values: self._starts())
        self._start = start or (lambda values: self._starts())
        self.log: list[str] = []

    def _starts(self) -> Values:
        return {port.name: port.start_value() for port in self.outputs}

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        self.log.append("initialize")
        return self._start(inputs)

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        self.log.append(f"do_step {time_ns} {step_ns}")
        return self._step(time_ns, step_ns, inputs)

    def terminate(self) -> None:
        self.log.append("terminate")


class Resumable(FunctionComponent):
    """Has no state."""

    def restore(self, state: bytes) -> None:
        assert state == b""


class ToyController:
    """Prints wherever the scan is below the target by more than half a droplet, until nothing is."""

    def __init__(self, job: Job) -> None:
        shape = (job.nx, job.ny)
        self._job = job
        self.inputs = contract_ports(shape, "measured_height", "valid", "layers_scanned", "layers_printed")
        own = (Port("objective", "m"), Port("estimated_height", "m", shape))
        self.outputs = (*contract_ports(shape, "pattern", "layer_command", "status"), *own)
        self._pattern = np.zeros(shape, np.int32)
        self._estimate = np.zeros(shape)
        self._answered = -1
        self._command = 0
        self._status = Status.IDLE

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        scanned, printed = int(inputs["layers_scanned"]), int(inputs["layers_printed"])
        if scanned == printed == self._command and scanned > self._answered:
            self._answered = scanned
            self._estimate = np.array(inputs["measured_height"])
            self._pattern = (self._job.target_height - self._estimate > DROPLET / 2).astype(np.int32)
            if self._pattern.any():
                self._command += 1
            else:
                self._status = Status.DONE
        return self._outputs()

    def terminate(self) -> None: ...

    def _outputs(self) -> Values:
        return {
            "pattern": self._pattern,
            "layer_command": np.asarray(self._command),
            "status": np.asarray(int(self._status)),
            "objective": np.asarray(float(self._pattern.sum())),
            "estimated_height": self._estimate,
        }


class ToyPrinter:
    """Adds a droplet where the pattern has one; refuses commands out of order."""

    def __init__(self, job: Job, duration_ns: int = 0) -> None:
        shape = (job.nx, job.ny)
        self.inputs = contract_ports(shape, "pattern", "layer_command")
        own = Port("droplets_a", dtype="int32")
        self.outputs = (*contract_ports(shape, "height", "layers_printed", "status"), own)
        self._duration_ns = duration_ns
        self._height = np.zeros(shape)
        self._printed = 0
        self._droplets = 0
        self._pending: tuple[int, np.ndarray] | None = None

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        command = int(inputs["layer_command"])
        if self._pending is None and command == self._printed + 1:
            self._pending = (time_ns + self._duration_ns, np.array(inputs["pattern"]))
        elif command != self._printed + (self._pending is not None):
            raise ValueError(f"layer_command {command} refused after layer {self._printed}")
        if self._pending is not None and time_ns + step_ns >= self._pending[0]:
            self._height = self._height + DROPLET * self._pending[1]
            self._droplets += int(self._pending[1].sum())
            self._printed += 1
            self._pending = None
        return self._outputs()

    def terminate(self) -> None: ...

    def _outputs(self) -> Values:
        return {
            "height": self._height,
            "layers_printed": np.asarray(self._printed),
            "status": np.asarray(int(self._pending is not None)),
            "droplets_a": np.asarray(self._droplets),
        }


class ToyProfiler:
    """Scans exactly, `duration_ns` after a layer was printed."""

    def __init__(self, job: Job, duration_ns: int = 0) -> None:
        shape = (job.nx, job.ny)
        self.inputs = contract_ports(shape, "height", "layers_printed")
        self.outputs = contract_ports(shape, "measured_height", "valid", "layers_scanned", "status")
        self._duration_ns = duration_ns
        self._scan = np.zeros(shape)
        self._scanned = -1
        self._pending: tuple[int, int, np.ndarray] | None = None

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        if self._pending is None and int(inputs["layers_printed"]) != self._scanned:
            self._pending = (time_ns + self._duration_ns, int(inputs["layers_printed"]), np.array(inputs["height"]))
        if self._pending is not None and time_ns + step_ns >= self._pending[0]:
            _, self._scanned, self._scan = self._pending
            self._pending = None
        return self._outputs()

    def terminate(self) -> None: ...

    def _outputs(self) -> Values:
        return {
            "measured_height": self._scan,
            "valid": np.full(self._scan.shape, self._scanned >= 0),
            "layers_scanned": np.asarray(self._scanned),
            "status": np.asarray(int(self._pending is not None)),
        }


def toy_loop(
    job: Job, printer_ns: int = 0, profiler_ns: int = 0
) -> dict[str, ToyController | ToyPrinter | ToyProfiler]:
    """Controller, printer and profiler in the order of the loop."""
    return {
        "controller": ToyController(job),
        "printer": ToyPrinter(job, printer_ns),
        "profiler": ToyProfiler(job, profiler_ns),
    }


def toy_result() -> Result:
    """Three layers of the toy loop."""
    job = toy_job(layers=3)
    parts = toy_loop(job)
    recorder = Recorder(job, parts)
    master = Master(
        parts,
        contract_connections(parts),
        step_ns=1_000_000_000,
        observers=[recorder],
        course=LayerCourse(parts, layers_max=10),
    )
    reason = master.run()
    return Result.of(
        recorder.dataset(),
        title="Block",
        label="closed loop",
        scenario_text="title = 'Block'  # µm\n",
        seed=7,
        stop_reason=reason,
        wall_s=master.wall_s,
        components=parts,
    )
