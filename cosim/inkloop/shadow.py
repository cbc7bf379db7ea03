"""A deposition model beside a rig: it follows what is commanded, and notices when the rig does something else."""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, Component, FloatMap, Job, Port, Status, Values
from inkloop.errors import ComponentError
from inkloop.scan_comparison import Divergence, ScannedLayer, start_surface

_LOG = logging.getLogger("inkloop.shadow")
_UM = 1e6

SCAN_INPUTS = ("measured_height", "valid", "layers_scanned")


class Shadow:
    """Deposits a layer on its plant when the printer says that it is done, with the pattern it was commanded with.

    make_plant: a plant of the layer contract that starts on `height_start` of the job it is handed.
    start: "scan": the scan of layer 0 is the surface to begin on; "job": that of the job, where no real surface is
    scanned. alarm, stop: growth divergence [m] (see `Divergence`) above which the status is untrusted, or a fault that
    ends the run (None: never). Raises ValueError for a plant that does not fit, later ComponentError.

    Outputs besides the surface and both divergences: `layers_followed`, the layer of `height`; `layers_compared`, the
    layer of the scan that the divergences belong to, -1 before the first.
    """

    is_shadow = True
    optional_inputs = frozenset(SCAN_INPUTS)

    def __init__(
        self,
        job: Job,
        make_plant: Callable[[Job], Component],
        *,
        start: Literal["scan", "job"] = "scan",
        alarm: float = 3e-6,
        stop: float | None = None,
    ) -> None:
        self._job, self._make_plant, self.start = job, make_plant, start
        self._alarm, self._stop = alarm, math.inf if stop is None else stop
        shape = (job.nx, job.ny)
        self._start_surface = np.zeros(shape) if job.height_start is None else np.array(job.height_start, np.float64)
        self._plant = make_plant(job)
        try:
            own = (
                Port("layers_printed", dtype="int32"),
                Port("measured_height", "m", shape),
                Port("valid", "1", shape, "bool"),
                Port("layers_scanned", dtype="int32", start=-1.0),
            )
            self.inputs = _checked_inputs(self._plant, shape) + own
        except ValueError:
            self._plant.terminate()
            raise
        self.outputs = (
            Port("height", "m", shape),
            Port("growth_divergence", "m", start=math.nan),
            Port("surface_divergence", "m", start=math.nan),
            Port("layers_followed", dtype="int32"),
            Port("layers_compared", dtype="int32", start=-1.0),
            Port("status", dtype="int32"),
        )
        self._reference = self._commanded = self._followed = self._plant_time_ns = 0
        self._compared = -1
        self._patterns: dict[int, Values] = {}
        self._surfaces: dict[int, FloatMap] = {}
        self._last_scan: ScannedLayer | None = None
        self._divergence, self._status = Divergence(), Status.IDLE

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Begin on the surface of the job; commands count from the present one."""
        self._reference = self._commanded = self._followed = int(inputs["layer_command"])
        self._begin(time_ns, self._start_surface)
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Take a new command, deposit what has been printed, compare what has been scanned. Raises ComponentError."""
        self._look(inputs)  # a scan of layer 0 is the surface to begin on: before the layer that it was waited for with
        self._take_command(inputs)
        self._follow(int(inputs["layers_printed"]), step_ns)
        self._look(inputs)
        return self._outputs()

    def terminate(self) -> None:
        """Terminate the plant."""
        self._plant.terminate()

    def save(self) -> bytes:
        """Counters, surfaces, patterns on their way and the plant's own state. Raises ComponentError without one."""
        if not hasattr(self._plant, "save"):
            raise ComponentError("the plant cannot save its state (it has no save)")
        state: dict[str, NDArray[Any]] = {
            "counters": np.array([self._reference, self._commanded, self._followed, self._plant_time_ns, self._compared,
                                  self._status], np.int64),
            "divergence": np.array([self._divergence.growth, self._divergence.surface]),
            "start": self._start_surface,
            "plant": np.frombuffer(self._plant.save(), np.uint8),
        }  # fmt: skip
        state |= {f"surface/{layer}": surface for layer, surface in self._surfaces.items()}
        for layer, taken in self._patterns.items():
            state |= {f"pattern/{layer}/{name}": np.asarray(value) for name, value in taken.items()}
        if self._last_scan is not None:
            state |= {f"scan/{name}": value for name, value in vars(self._last_scan).items()}
        buffer = io.BytesIO()
        np.savez(buffer, **state)  # type: ignore[arg-type]
        return buffer.getvalue()

    def restore(self, saved: bytes) -> None:
        """Go on from a saved state. Raises ComponentError if it is none, or the plant refuses it."""
        try:
            with np.load(io.BytesIO(saved), allow_pickle=False) as stored:
                state = {key: stored[key] for key in stored.files}
            counters = [int(count) for count in state["counters"]]
            growth, surface = (float(value) for value in state["divergence"])
            start, plant_state = state["start"], state["plant"].tobytes()
        except (ValueError, KeyError, OSError, BadZipFile) as error:
            raise ComponentError(f"what is to be restored is no state of a shadow ({error})") from error
        if not hasattr(self._plant, "restore"):
            raise ComponentError("the plant cannot restore a state (it has no restore)")
        self._reference, self._commanded, self._followed, clock_ns, self._compared, status = counters
        self._begin(clock_ns, start)
        self._plant.restore(plant_state)
        self._divergence, self._status = Divergence(growth, surface), Status(status)
        self._surfaces = {int(key.split("/")[1]): value for key, value in state.items() if key.startswith("surface/")}
        self._patterns = {}
        for key, value in state.items():
            if key.startswith("pattern/"):
                _, layer, name = key.split("/")
                self._patterns[int(layer)] = {**self._patterns.get(int(layer), {}), name: value}
        scan = {key.removeprefix("scan/"): value for key, value in state.items() if key.startswith("scan/")}
        self._last_scan = ScannedLayer(**scan) if scan else None

    def _begin(self, time_ns: int, surface: FloatMap) -> None:
        """Start the plant on a surface, a new one if the present one stands on another."""
        if surface is not self._start_surface:
            self._plant.terminate()
            self._plant = self._make_plant(replace(self._job, height_start=surface))
            self._start_surface = surface
        self._plant_time_ns = time_ns
        values = self._plant.initialize(time_ns, self._plant_starts())
        self._surfaces = {self._followed: _surface(values)}

    def _plant_starts(self) -> Values:
        starts = {port.name: port.start_value() for port in self._plant.inputs}
        return {**starts, "layer_command": np.asarray(self._followed, np.int32)}

    def _take_command(self, inputs: Values) -> None:
        command = int(inputs["layer_command"])
        if command == self._commanded:
            return
        if command != self._commanded + 1:
            raise ComponentError(
                f"layer_command is {command} after {self._commanded}: a pattern was missed; step the shadow as often "
                "as the controller"
            )
        taken = {port.name: np.array(inputs[port.name]) for port in self._plant.inputs if port.name in inputs}
        self._patterns[command] = taken
        self._commanded = command

    def _follow(self, printed: int, step_ns: int) -> None:
        """Deposit every layer that the printer has completed since."""
        while self._followed < printed:
            layer = self._followed + 1
            if layer not in self._patterns:
                raise ComponentError(f"layers_printed is {printed}, but layer {layer} was never commanded")
            values = self._plant.do_step(self._plant_time_ns, step_ns, self._patterns.pop(layer))
            self._plant_time_ns += step_ns
            if int(values["layers_printed"]) != layer:
                raise ComponentError(
                    f"the plant has not completed layer {layer} in one step of {step_ns * 1e-9:g} s; leave its "
                    "duration out (the printer says when a layer is done)"
                )
            self._followed = layer
            self._surfaces[layer] = _surface(values)

    def _look(self, inputs: Values) -> None:
        """Compare a scan that is new and of a layer that has been followed."""
        if "layers_scanned" not in inputs:
            self._surfaces = {self._followed: self._surfaces[self._followed]}
            return
        scanned = int(inputs["layers_scanned"])
        if scanned > self._compared and scanned in self._surfaces:
            self._compare(scanned, np.array(inputs["measured_height"], np.float64), np.array(inputs["valid"], np.bool_))

    def _compare(self, layer: int, measured: FloatMap, valid: BoolMap) -> None:
        if self._last_scan is None and self._followed == layer == self._reference and self.start == "scan":
            self._begin(self._plant_time_ns, start_surface(self._start_surface, measured, valid))
            if not np.allclose(self._surfaces[layer], self._start_surface, rtol=0.0, atol=1e-9):
                _LOG.warning("the plant takes no start surface (height_start); it begins on its own, and the surface "
                             "divergence holds what the real one is off by")  # fmt: skip
        scan = ScannedLayer(measured, valid, self._surfaces[layer])
        self._divergence = scan.divergence(self._last_scan, self._job.mask)
        self._status = self._judged(layer) if self._last_scan is not None else Status.IDLE
        self._last_scan, self._compared = scan, layer
        self._surfaces = {number: surface for number, surface in self._surfaces.items() if number >= layer}

    def _judged(self, layer: int) -> Status:
        """The status after the scan of a layer; an alarm is said in words."""
        growth = self._divergence.growth
        if math.isnan(growth):
            _LOG.warning("layer %d: no cell of the part was seen in its scan and in the one before; nothing can be "
                         "compared with the model", layer)  # fmt: skip
            return Status.UNTRUSTED
        said = f"layer {layer} grew otherwise than the model says, by {growth * _UM:.2f} um rms over the part"
        if growth > self._stop:
            _LOG.error("%s; more than stop_um = %g: the run ends. Look at the part and at the print head", said,
                       self._stop * _UM)  # fmt: skip
            return Status.FAULT
        if growth > self._alarm:
            _LOG.warning("%s; more than alarm_um = %g. Look at the print head and at the scan", said, self._alarm * _UM)
            return Status.UNTRUSTED
        return Status.IDLE

    def _outputs(self) -> Values:
        return {
            "height": self._surfaces[self._followed].copy(),
            "growth_divergence": np.asarray(self._divergence.growth),
            "surface_divergence": np.asarray(self._divergence.surface),
            "layers_followed": np.asarray(self._followed, np.int32),
            "layers_compared": np.asarray(self._compared, np.int32),
            "status": np.asarray(int(self._status), np.int32),
        }


def _surface(values: Values) -> FloatMap:
    return np.array(values["height"], np.float64)


def _checked_inputs(plant: Component, shape: tuple[int, int]) -> tuple[Port, ...]:
    """The inputs of a plant that follows the layer contract. Raises ValueError for any other."""
    inputs = {port.name: port for port in plant.inputs}
    outputs = {port.name: port for port in plant.outputs}
    missing = [name for name in ("pattern", "layer_command") if name not in inputs]
    missing += [name for name in ("height", "layers_printed") if name not in outputs]
    if missing:
        raise ValueError(f"plant has no {', '.join(missing)}; needs those of the layer contract")
    if outputs["height"].shape != shape or outputs["height"].unit != "m":
        found = outputs["height"]
        raise ValueError(f"plant has height of shape {found.shape} in [{found.unit}]; needs {shape} in [m]")
    if twice := sorted(set(inputs) & {"layers_printed", *SCAN_INPUTS}):
        raise ValueError(f"plant takes {', '.join(twice)}, which a deposition model does not; name another plant")
    return plant.inputs
