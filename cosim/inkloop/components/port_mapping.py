"""Map an FMU with other names, units and shapes to the ports of the layer contract."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Port, Values
from inkloop.errors import ComponentError
from inkloop.fmu import FmuComponent
from inkloop.master.orientation import OWN, Orientation


@dataclass(frozen=True)
class MappedPort:
    """A port and the variables of the FMU behind it, in the order of its cells, last index fastest.

    One variable may hold all cells. The FMU's own number is factor * (number in the unit of the port) + offset;
    orientation: of the FMU's maps.
    """

    port: Port
    variables: Sequence[Port]
    factor: float = 1.0
    offset: float = 0.0
    orientation: Orientation = OWN

    def to_fmu(self, value: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """Values of the FMU's variables for a value of the port. Raises ComponentError if they cannot hold it."""
        own = self._own_numbers(self.orientation.there(np.asarray(value))).reshape(-1)
        if len(self.variables) == 1:
            return {self.variables[0].name: own.reshape(self.variables[0].shape)}
        return {variable.name: own[cell].reshape(variable.shape) for cell, variable in enumerate(self.variables)}

    def from_fmu(self, values: Values) -> NDArray[Any]:
        """The value of the port. Raises ComponentError where whole numbers are due and there are none."""
        found = np.concatenate([np.asarray(values[variable.name]).reshape(-1) for variable in self.variables])
        if self.factor != 1.0 or self.offset != 0.0:
            found = (found - self.offset) / self.factor
        if np.dtype(self.port.dtype).kind == "b":
            found = found != 0
        there = held(found, self.port.dtype, f"{self.port.name}, read from {self._names},")
        there = there.reshape(self.orientation.shape(self.port.shape))
        return np.ascontiguousarray(self.orientation.here(there)).reshape(self.port.shape)

    def start(self) -> NDArray[Any]:
        """The start values of the variables, as the value of the port."""
        return self.from_fmu({variable.name: variable.start_value() for variable in self.variables})

    def _own_numbers(self, value: NDArray[Any]) -> NDArray[Any]:
        dtype = self.variables[0].dtype
        if self.factor != 1.0 or self.offset != 0.0:
            value = value * self.factor + self.offset
        return held(value, dtype, f"{self.port.name}, given to {self._names},")

    @property
    def _names(self) -> str:
        first, last = self.variables[0].name, self.variables[-1].name
        return first if first == last else f"{first} to {last}"


def held(values: NDArray[Any], dtype: str, what: str) -> NDArray[Any]:
    """Numbers in another type. Raises ComponentError where it is no floating-point type and does not hold them."""
    with np.errstate(invalid="ignore"):
        cast = values.astype(dtype)
    if cast.dtype.kind != "f" and (wrong := values[cast != values]).size:
        needed = "needs 0 or 1" if cast.dtype.kind == "b" else f"needs whole numbers that {dtype} holds"
        raise ComponentError(f"{what} is {wrong.flat[0].item()!r}; {needed}")
    return cast


class MappedPorts:
    """Runs an FMU and translates its mapped inputs and outputs; the others pass unchanged."""

    def __init__(self, fmu: FmuComponent, inputs: Sequence[MappedPort], outputs: Sequence[MappedPort]) -> None:
        self._fmu, self._mapped_inputs, self._mapped_outputs = fmu, inputs, outputs
        self.sha256 = fmu.sha256
        self.inputs = ports_of(inputs, fmu.inputs)
        self.outputs = ports_of(outputs, fmu.outputs)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Start the FMU; outputs at `time_ns`."""
        return self._translated(self._fmu.initialize(time_ns, self._to_fmu(inputs)))

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Advance the FMU by one communication step."""
        return self._translated(self._fmu.do_step(time_ns, step_ns, self._to_fmu(inputs)))

    def exchange(self, received: Mapping[str, bytes]) -> dict[str, bytes]:
        """Give operations to buses of the FMU, by name; what they have sent since."""
        return self._fmu.exchange(received)

    def terminate(self) -> None:
        """End the FMU."""
        self._fmu.terminate()

    def save(self) -> bytes:
        """The state of the FMU, which is the whole state. Raises ComponentError if the FMU cannot give it."""
        return self._fmu.save()

    def restore(self, state: bytes) -> None:
        """Put the FMU back into a saved state."""
        self._fmu.restore(state)

    def _to_fmu(self, inputs: Values) -> Values:
        taken = {mapped.port.name for mapped in self._mapped_inputs}
        values = {name: value for name, value in inputs.items() if name not in taken}
        for mapped in self._mapped_inputs:
            if mapped.port.name in inputs:
                values |= mapped.to_fmu(inputs[mapped.port.name])
        return values

    def _translated(self, values: Values) -> Values:
        mapped = {each.port.name: each.from_fmu(values) for each in self._mapped_outputs}
        return {port.name: mapped[port.name] if port.name in mapped else values[port.name] for port in self.outputs}


def ports_of(mapped: Sequence[MappedPort], own: Sequence[Port]) -> tuple[Port, ...]:
    """The mapped ports, then those of the FMU that no mapping takes."""
    taken = {variable.name for each in mapped for variable in each.variables}
    return (*(each.port for each in mapped), *(port for port in own if port.name not in taken))
