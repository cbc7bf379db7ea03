"""Devices for tests: a printer that does not report its surface, and a profiler that sees it without an input."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from inkloop.component import Job, Values
from support.toys import ToyPrinter, ToyProfiler


class DevicePrinter:
    """A toy printer as a device; `surface` is what lies on its bed, `disturb` what happens to a pattern on its way."""

    is_device = True

    def __init__(self, job: Job, duration_ns: int = 0, plate: np.ndarray | None = None) -> None:
        self._printer = ToyPrinter(job, duration_ns)
        self._plate = np.zeros((job.nx, job.ny)) if plate is None else plate
        self.inputs = self._printer.inputs
        self.outputs = tuple(port for port in self._printer.outputs if port.name not in ("height", "droplets_a"))
        self.disturb: Callable[[int, np.ndarray], np.ndarray] = lambda layer, pattern: pattern
        self.surface = self._plate

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return self._reported(self._printer.initialize(time_ns, inputs))

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        jetted = self.disturb(int(inputs["layer_command"]), np.array(inputs["pattern"]))
        return self._reported(self._printer.do_step(time_ns, step_ns, {**inputs, "pattern": jetted}))

    def terminate(self) -> None: ...

    def _reported(self, values: Values) -> Values:
        self.surface = self._plate + values["height"]
        return {port.name: np.asarray(values[port.name], port.dtype) for port in self.outputs}


class DeviceProfiler:
    """Scans the bed of a device printer, or an empty one; cells where `blind` is true are not seen."""

    is_device = True

    def __init__(self, job: Job, printer: DevicePrinter | None = None, duration_ns: int = 0) -> None:
        self._profiler, self._printer = ToyProfiler(job, duration_ns), printer
        self.inputs = tuple(port for port in self._profiler.inputs if port.name != "height")
        self.outputs = self._profiler.outputs
        self.blind = np.zeros((job.nx, job.ny), np.bool_)
        self._empty = np.zeros((job.nx, job.ny))

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return self._profiler.initialize(time_ns, inputs)

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        surface = self._empty if self._printer is None else self._printer.surface
        scan = self._profiler.do_step(time_ns, step_ns, {**inputs, "height": surface})
        seen = scan["valid"] & ~self.blind
        return {**scan, "measured_height": np.where(seen, scan["measured_height"], 0.0), "valid": seen}

    def terminate(self) -> None: ...


class StartingPrinter(ToyPrinter):
    """A toy plant for a shadow: it begins on the surface of its job, and can be saved."""

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self._start = np.zeros((job.nx, job.ny)) if job.height_start is None else np.array(job.height_start)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        self._height, self._printed = self._start, int(inputs["layer_command"])
        return self._outputs()

    def save(self) -> bytes:
        return np.append(self._height.ravel(), self._printed).tobytes()

    def restore(self, saved: bytes) -> None:
        values = np.frombuffer(saved)
        self._height, self._printed = values[:-1].reshape(self._height.shape).copy(), int(values[-1])
