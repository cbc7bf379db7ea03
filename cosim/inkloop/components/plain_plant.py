"""A plant without the handshake of the layer contract: its input is a pattern, its output a surface, each step a
layer.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from inkloop.component import Component, HasPorts, Job, Port, Ports, Status, Values
from inkloop.component_errors import repeated
from inkloop.components.kind import Bench, Check, Checked
from inkloop.components.port_mapping import held
from inkloop.contract import HEIGHT, LAYER_COMMAND, LAYERS_PRINTED, PATTERN, STATUS, checked_command, contract_ports
from inkloop.errors import ComponentError, nearest
from inkloop.units import conversion

KIND = "PlainPlant"
_PORT_OPTIONS = ("pattern_input", "height_output")
_COUNTER_BYTES = 8


class PlainPlant:
    """Steps its plant once for each layer commanded, and keeps the handshake for it.

    pattern_input: the pattern, any number type; height_output: the surface, in a unit of length. Both hold nx * ny
    values, as a map or flat with the last index fastest. The plant's own clock advances in its own steps only, each as
    long as the communication step of its layer. Its other ports are handed through. Raises ValueError for a plant that
    does not fit, later ComponentError.
    """

    def __init__(
        self, job: Job, plant: Component, *, pattern_input: str = PATTERN, height_output: str = HEIGHT
    ) -> None:
        self._plant, self._shape = plant, (job.nx, job.ny)
        ports = wrapped_ports(job, plant, pattern_input=pattern_input, height_output=height_output)
        self.inputs, self.outputs = ports.inputs, ports.outputs
        self._pattern = next(port for port in plant.inputs if port.name == pattern_input)
        self._height = next(port for port in plant.outputs if port.name == height_output)
        self._factor = conversion(self._height.unit, "m") or 1.0
        self._printed = self._plant_time_ns = 0
        self._values: Values = {}

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Get the plant ready with an empty pattern; commands count from the present one."""
        self._printed, self._plant_time_ns = int(inputs[LAYER_COMMAND]), time_ns
        empty = np.zeros(self._shape, np.int32)
        self._values = self._plant.initialize(time_ns, self._plant_inputs({**inputs, PATTERN: empty}))
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """One step of the plant for a new command, none otherwise. Raises ComponentError for a command out of order."""
        command = checked_command(inputs, self._printed)
        if command == self._printed + 1:
            self._values = self._plant.do_step(self._plant_time_ns, step_ns, self._plant_inputs(inputs))
            self._plant_time_ns += step_ns
            self._printed = command
        return self._outputs()

    def terminate(self) -> None:
        """Terminate the plant."""
        self._plant.terminate()

    def save(self) -> bytes:
        """Counter, clock and last outputs, then the plant's own state. Raises ComponentError if it cannot be had."""
        if not hasattr(self._plant, "save"):
            raise ComponentError("the plant cannot save its state (it has no save)")
        parts = [np.array([self._printed, self._plant_time_ns], np.int64).tobytes()]
        parts += [np.ascontiguousarray(self._values[port.name], port.dtype).tobytes() for port in self._plant.outputs]
        state: bytes = self._plant.save()
        return b"".join([*parts, state])

    def restore(self, saved: bytes) -> None:
        """Continue from a saved state. Raises ComponentError if it is too short to be one, or the plant refuses it."""
        if not hasattr(self._plant, "restore"):
            raise ComponentError("the plant cannot restore a state (it has no restore)")
        offset, values = 2 * _COUNTER_BYTES, {}
        try:
            printed, plant_time_ns = np.frombuffer(saved, np.int64, 2)
            for port in self._plant.outputs:
                start = port.start_value()
                values[port.name] = np.frombuffer(saved, port.dtype, start.size, offset).reshape(port.shape)
                offset += start.nbytes
        except ValueError as error:
            raise ComponentError(f"what is to be restored is no state of this plant ({error})") from error
        self._plant.restore(saved[offset:])
        self._printed, self._plant_time_ns, self._values = int(printed), int(plant_time_ns), values

    def _plant_inputs(self, inputs: Values) -> Values:
        handed = {name: value for name, value in inputs.items() if name not in (PATTERN, LAYER_COMMAND)}
        pattern = np.asarray(inputs[PATTERN]).reshape(self._pattern.shape)
        return {**handed, self._pattern.name: held(pattern, self._pattern.dtype, self._pattern.name)}

    def _outputs(self) -> Values:
        handed = {name: value for name, value in self._values.items() if name != self._height.name}
        surface = np.asarray(self._values[self._height.name], np.float64).reshape(self._shape)
        return {
            **handed,
            HEIGHT: surface * self._factor,
            LAYERS_PRINTED: np.asarray(self._printed, np.int32),
            STATUS: np.asarray(int(Status.IDLE), np.int32),
        }


def wrapped_ports(job: Job, plant: HasPorts, *, pattern_input: str = PATTERN, height_output: str = HEIGHT) -> Ports:
    """The ports of a `PlainPlant` around a plant. Raises ValueError if the plant does not fit."""
    shape = (job.nx, job.ny)
    errors = [
        *_port_errors(plant.inputs, "pattern_input", pattern_input, shape),
        *_port_errors(plant.outputs, "height_output", height_output, shape),
    ]
    if errors:
        raise ValueError("; ".join(errors))
    height = next(port for port in plant.outputs if port.name == height_output)
    if conversion(height.unit, "m") is None:
        raise ValueError(f"height_output is {height_output!r}, which is in [{height.unit}]; needs a length")
    own_inputs = contract_ports(shape, PATTERN, LAYER_COMMAND)
    own_outputs = contract_ports(shape, HEIGHT, LAYERS_PRINTED, STATUS)
    inputs = own_inputs + tuple(port for port in plant.inputs if port.name != pattern_input)
    outputs = own_outputs + tuple(port for port in plant.outputs if port.name != height_output)
    for ports in (inputs, outputs):
        if twice := repeated(port.name for port in ports):
            raise ValueError(f"plant has {', '.join(twice)} of its own: it keeps the handshake; name it as kind")
    return Ports(inputs, outputs)


def _port_errors(ports: tuple[Port, ...], option: str, name: str, shape: tuple[int, int]) -> list[str]:
    known = {port.name: port for port in ports}
    if name not in known:
        return [f"{option} is {name!r}, which the plant does not have; {nearest(name, known)}"]
    nx, ny = shape
    if known[name].shape not in (shape, (nx * ny,)):
        return [f"{option} is {name!r} of shape {known[name].shape}; needs {nx} x {ny} values, as the grid"]
    return []


class PlainPlantKind:
    """The kind of a `PlainPlant`: `plant` is the kind of the plant itself, its options stand in the same table."""

    path_option: ClassVar[str | None] = "file"

    def __init__(self, check: Check) -> None:
        self._check = check

    def check(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Check the options of the plant, then whether its ports fit."""
        names = {name: options[name] for name in _PORT_OPTIONS if name in options}
        errors = [
            f"{name} is {value!r}; expected the name of a port"
            for name, value in names.items()
            if not isinstance(value, str)
        ]
        kind = options.get("plant", "Fmu")
        if not isinstance(kind, str) or kind == KIND:
            errors.append(f"plant is {kind!r}; expected a kind, such as 'Fmu' or 'package.module:Class'")
            return Checked(KIND, errors)
        own = {name: value for name, value in options.items() if name not in ("plant", *_PORT_OPTIONS)}
        plant = self._check(kind, job, own)
        if errors or plant.ports is None:
            return Checked(KIND, [*errors, *plant.errors])
        chosen = {name: str(value) for name, value in names.items()}
        try:
            ports = wrapped_ports(job, plant.ports, **chosen)
        except ValueError as error:
            return Checked(KIND, [str(error)])

        def construct(bench: Bench, name: str) -> Component:
            return PlainPlant(job, plant.make(bench, name), **chosen)

        return Checked(KIND, (), ports, construct, plant.single)
