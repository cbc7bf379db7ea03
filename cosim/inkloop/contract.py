"""The layer contract: signals by which controller, printer and profiler print layer after layer, and their passes.

Every part acts on sequence numbers, so that it works with any master, order and step size; the rules are on the page
docs/reference/layer-contract.md. A printer is a deposition model or a print head, a profiler a sensor, simulated or
real.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from inkloop.component import Port, Values
from inkloop.errors import ComponentError

CONTROLLER, PRINTER, PROFILER, SHADOW = "controller", "printer", "profiler", "shadow"
"""Roles in the loop; a shadow is a model that deposits what the printer is commanded."""

PATTERN = "pattern"
DROP_LEVEL = "drop_level"
LAYER_COMMAND = "layer_command"
LAYERS_PRINTED = "layers_printed"
HEIGHT = "height"
MEASURED_HEIGHT = "measured_height"
VALID = "valid"
LAYERS_SCANNED = "layers_scanned"
LAYER_UNKNOWN = "layer_unknown"
STATUS = "status"
STOP_REASON = "stop_reason"
LOOKED_AT = "looked_at"

LAYERS_FOLLOWED = "layers_followed"
"""Layers that a shadow has deposited: replaces LAYERS_PRINTED for a profiler that scans the shadow."""
LAYERS_COMPARED = "layers_compared"
"""Layers that a shadow has compared with their scan."""


@dataclass(frozen=True)
class Signal:
    """One signal: `unit` in FMI spelling, `is_map` for one value per cell, NumPy `dtype`, value before the first step.

    giver: role that outputs it, None for every role, or for the master; takers: roles that read it. An optional signal
    may stay unconnected at its start value.
    """

    name: str
    unit: str = "1"
    is_map: bool = False
    dtype: str = "int32"
    start: float = 0.0
    giver: str | None = None
    takers: tuple[str, ...] = ()
    is_optional: bool = False

    def port(self, shape: tuple[int, int]) -> Port:
        """The signal as a port of a component on a grid of (nx, ny) cells."""
        return Port(self.name, self.unit, shape if self.is_map else (), self.dtype, self.start)


SIGNALS: Mapping[str, Signal] = {
    signal.name: signal
    for signal in (
        Signal(PATTERN, is_map=True, giver=CONTROLLER, takers=(PRINTER,)),
        Signal(DROP_LEVEL, is_map=True, start=1, giver=CONTROLLER, takers=(PRINTER,), is_optional=True),
        Signal(LAYER_COMMAND, giver=CONTROLLER, takers=(PRINTER,)),
        Signal(LAYERS_PRINTED, giver=PRINTER, takers=(PROFILER, CONTROLLER)),
        Signal(HEIGHT, "m", is_map=True, dtype="float64", giver=PRINTER, takers=(PROFILER,)),
        Signal(MEASURED_HEIGHT, "m", is_map=True, dtype="float64", giver=PROFILER, takers=(CONTROLLER,)),
        Signal(VALID, is_map=True, dtype="bool", giver=PROFILER, takers=(CONTROLLER,)),
        Signal(LAYERS_SCANNED, start=-1, giver=PROFILER, takers=(CONTROLLER,)),
        Signal(LAYER_UNKNOWN, dtype="bool", giver=PRINTER, takers=(CONTROLLER,), is_optional=True),
        Signal(STATUS),
        Signal(STOP_REASON, giver=CONTROLLER, is_optional=True),
        Signal(LOOKED_AT, dtype="bool", takers=(CONTROLLER,), is_optional=True),
    )
}
"""The signals by name."""

COUNTERS = (LAYER_COMMAND, LAYERS_PRINTED, LAYERS_SCANNED)
"""Sequence numbers of layers; the giver of each one has the role that belongs to it."""

REQUIRED_INPUTS = frozenset(name for name, signal in SIGNALS.items() if signal.takers and not signal.is_optional)
"""Inputs without which the handshake cannot run; any other may stay unconnected at its start value."""


def contract_ports(shape: tuple[int, int], *names: str) -> tuple[Port, ...]:
    """Signals as ports of a component on a grid of `shape` cells."""
    return tuple(SIGNALS[name].port(shape) for name in names)


def has_port(ports: tuple[Port, ...], name: str) -> bool:
    """Whether a port of that name is among `ports`."""
    return any(port.name == name for port in ports)


def checked_command(inputs: Values, printed: int) -> int:
    """The layer commanded: the last one printed, or the one after it. Raises ComponentError for any other."""
    command = int(inputs[LAYER_COMMAND])
    if command not in (printed, printed + 1):
        raise ComponentError(f"{LAYER_COMMAND} is {command} after layer {printed}; needs {printed} or {printed + 1}")
    return command


class PassOrder(IntEnum):
    """`pass_order`: the order in which the four passes of a layer jet their colours."""

    RASTER = 1
    DIAGONAL = 2

    @property
    def colours(self) -> tuple[int, ...]:
        """Colours as `pass_colour` numbers them, in the order they are jetted."""
        return (0, 1, 2, 3) if self is PassOrder.RASTER else (0, 3, 1, 2)


def pass_colour(i: Any, j: Any) -> Any:
    """Colour 0 to 3 of cell (i, j) in the 2x2 colouring of four passes; i, j: integers, or integer arrays."""
    return 2 * (i % 2) + j % 2


def pass_colours(passes: int, order: int, rotation: int, layer: int) -> tuple[int, ...]:
    """Colours in the order in which layer `layer` (counted from 1) jets them; none in one pass."""
    if passes == 1:
        return ()
    colours = PassOrder(order).colours
    first = rotation * layer % len(colours)
    return colours[first:] + colours[:first]
