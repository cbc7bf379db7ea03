"""A plant that replicates another printer: it deposits each commanded pattern once the printer reports it done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Component, FloatMap, HasPorts, Job, Port, Values
from inkloop.contract import HEIGHT, LAYER_COMMAND, LAYERS_PRINTED, PATTERN
from inkloop.errors import ComponentError
from inkloop.units import S_PER_NS


class FollowedPlant:
    """A plant of the layer contract on a clock of its own, each of its steps a layer.

    make_plant: makes one that starts on `height_start` of the job it is handed. surfaces: (nx, ny) [m] by layer, from
    the first that is still wanted up to `layer`, the last deposited. Raises ValueError for a plant that does not fit,
    later ComponentError.
    """

    def __init__(self, job: Job, make_plant: Callable[[Job], Component]) -> None:
        self._job, self._make_plant = job, make_plant
        shape = (job.nx, job.ny)
        self.start_surface = np.zeros(shape) if job.height_start is None else np.array(job.height_start, np.float64)
        self.surfaces: dict[int, FloatMap] = {}
        self.layer = self.commanded = self._time_ns = 0
        self._patterns: dict[int, Values] = {}
        self._plant = make_plant(job)
        try:
            self.inputs = checked_inputs(self._plant, shape)
        except ValueError:
            self._plant.terminate()
            raise

    def begin(self, layer: int) -> None:
        """Start on the surface of the job, with `layer` layers printed already."""
        self.layer = self.commanded = layer
        self._initialize()

    def begin_on(self, surface: FloatMap) -> None:
        """Start again on another surface, at the present layer; patterns not yet deposited are kept."""
        old, self._plant = self._plant, self._make_plant(replace(self._job, height_start=surface))
        old.terminate()
        self.start_surface = surface
        self._initialize()

    def take_command(self, inputs: Values) -> None:
        """Keep the pattern of a new command and the plant's other inputs. ComponentError for a missed command."""
        command = int(inputs[LAYER_COMMAND])
        if command == self.commanded:
            return
        if command != self.commanded + 1:
            raise ComponentError(
                f"layer_command is {command} after {self.commanded}: a pattern was missed; step the shadow as often as "
                "the controller"
            )
        self._patterns[command] = {
            port.name: np.array(inputs[port.name]) for port in self.inputs if port.name in inputs
        }
        self.commanded = command

    def follow(self, printed: int, step_ns: int) -> None:
        """Deposit every layer up to `printed`, one step of the plant each. ComponentError for one never commanded."""
        while self.layer < printed:
            layer = self.layer + 1
            if layer not in self._patterns:
                raise ComponentError(f"layers_printed is {printed}, but layer {layer} was never commanded")
            values = self._plant.do_step(self._time_ns, step_ns, self._patterns.pop(layer))
            self._time_ns += step_ns
            if int(values[LAYERS_PRINTED]) != layer:
                raise ComponentError(
                    f"the plant has not completed layer {layer} in one step of {step_ns * S_PER_NS:g} s; leave its "
                    "duration out (the printer reports when a layer is done)"
                )
            self.layer = layer
            self.surfaces[layer] = np.array(values[HEIGHT], np.float64)

    def forget_before(self, layer: int) -> None:
        """Discard surfaces of layers before this one."""
        self.surfaces = {number: surface for number, surface in self.surfaces.items() if number >= layer}

    def terminate(self) -> None:
        """Terminate the plant."""
        self._plant.terminate()

    def state(self) -> dict[str, NDArray[Any]]:
        """The complete state as arrays. ComponentError if the plant's own state is not available."""
        if not hasattr(self._plant, "save"):
            raise ComponentError("the plant cannot save its state (it has no save)")
        state: dict[str, NDArray[Any]] = {
            "counters": np.array([self.layer, self.commanded, self._time_ns], np.int64),
            "start": self.start_surface,
            "plant": np.frombuffer(self._plant.save(), np.uint8),
        }
        state |= {f"surface/{layer}": surface for layer, surface in self.surfaces.items()}
        for layer, taken in self._patterns.items():
            state |= {f"pattern/{layer}/{name}": np.asarray(value) for name, value in taken.items()}
        return state

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a result of `state`. KeyError, ValueError for other data, ComponentError of the plant."""
        if not hasattr(self._plant, "restore"):
            raise ComponentError("the plant cannot restore a state (it has no restore)")
        self.layer, self.commanded, self._time_ns = (int(count) for count in state["counters"])
        self.begin_on(state["start"])
        self._plant.restore(state["plant"].tobytes())
        self.surfaces, patterns = {}, dict[int, dict[str, NDArray[Any]]]()
        for key, value in state.items():
            kind, _, rest = key.partition("/")
            if kind == "surface":
                self.surfaces[int(rest)] = value
            elif kind == "pattern":
                layer, _, name = rest.partition("/")
                patterns.setdefault(int(layer), {})[name] = value
        self._patterns = dict(patterns)

    def _initialize(self) -> None:
        starts = {port.name: port.start_value() for port in self.inputs}
        values = self._plant.initialize(self._time_ns, {**starts, LAYER_COMMAND: np.asarray(self.layer, np.int32)})
        self.surfaces = {self.layer: np.array(values[HEIGHT], np.float64)}


def checked_inputs(plant: HasPorts, shape: tuple[int, int]) -> tuple[Port, ...]:
    """The inputs of a plant that follows the layer contract. Raises ValueError for any other."""
    inputs = {port.name for port in plant.inputs}
    outputs = {port.name: port for port in plant.outputs}
    missing = [name for name in (PATTERN, LAYER_COMMAND) if name not in inputs]
    missing += [name for name in (HEIGHT, LAYERS_PRINTED) if name not in outputs]
    if missing:
        raise ValueError(f"plant has no {', '.join(missing)}; needs those of the layer contract")
    height = outputs[HEIGHT]
    if height.shape != shape or height.unit != "m":
        raise ValueError(f"plant has height of shape {height.shape} in [{height.unit}]; needs {shape} in [m]")
    return plant.inputs
