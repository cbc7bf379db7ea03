"""The component interface, its ports, and the job that every component receives.

An FMU, the layer controller and a CAN device all fulfil `Component`. The master asks nothing more of them,
and a class of one's own needs nothing else to take part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from inkloop.component_errors import errors_of_job, errors_of_port

Values: TypeAlias = Mapping[str, NDArray[Any]]
"""Port name -> array of the port's shape and dtype (a scalar is an array of shape ())."""

FloatMap: TypeAlias = NDArray[np.float64]
"""(nx, ny) heights [m], i along x, j along y."""

BoolMap: TypeAlias = NDArray[np.bool_]
"""(nx, ny) marks."""

HeightIntervals: TypeAlias = Sequence[tuple[FloatMap, FloatMap]]
"""Bottom and top of intervals of height [m], both ends included; empty where the bottom is above the top."""


DEVICE_LOGGER = "inkloop_hardware"
"""Logger of the devices, whose messages are shown while a part is printed."""


class Status(IntEnum):
    """`status` of every part of the layer contract, the same codes in FMUs, Python and on the bus."""

    IDLE = 0
    BUSY = 1
    DONE = 2
    FAULT = 3
    UNTRUSTED = 4


@dataclass(frozen=True, eq=False)
class Port:
    """One input or output: `unit` in FMI spelling ("m", "s", "1"), `shape` () for a scalar, NumPy `dtype` by name.

    `start` is the value before the first step, one number for all elements or an array of the port's shape.
    Raises ValueError, all errors in one sentence, for a port that cannot be.
    """

    name: str
    unit: str = "1"
    shape: tuple[int, ...] = ()
    dtype: str = "float64"
    start: float | NDArray[Any] = 0.0

    def __post_init__(self) -> None:
        if errors := errors_of_port(self):
            raise ValueError(f"ports: {self.name!r}: {'; '.join(errors)}")

    def start_value(self) -> NDArray[Any]:
        """The start value as an array of the port's shape and dtype."""
        return np.array(np.broadcast_to(self.start, self.shape), dtype=self.dtype)

    def _key(self) -> tuple[object, ...]:
        start = np.asarray(self.start, np.float64) + 0.0  # -0.0 is 0.0
        return self.name, self.unit, self.shape, self.dtype, start.shape, start.tobytes()

    def __eq__(self, other: object) -> bool:
        """Equal in every field; two ports that start as nan are equal in that, too."""
        return self._key() == other._key() if isinstance(other, Port) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())


@runtime_checkable
class Component(Protocol):
    """A part of the loop. Times are integer nanoseconds.

    `save() -> bytes` and `restore(bytes)` are optional; without them a run cannot be resumed. The class may
    set: `is_device = True`, it acts on or measures something real; `is_shadow = True`, it is a model next to a device,
    and its outputs give way to those of the same name of others; `optional_inputs`, names of inputs of the layer
    contract that may stay unconnected.
    """

    @property
    def inputs(self) -> tuple[Port, ...]:
        """Ports that `do_step` expects."""

    @property
    def outputs(self) -> tuple[Port, ...]:
        """Ports that `initialize` and `do_step` return."""

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Get ready to step from `time_ns`; returns the outputs at that time."""

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Advance from `time_ns` by `step_ns` with `inputs` held; returns the outputs at the end."""

    def terminate(self) -> None:
        """Release everything; called exactly once, also after a failure."""


class HasPorts(Protocol):
    """Ports for connections and events: of a component, or the `Ports` of one that is not built yet."""

    @property
    def inputs(self) -> tuple[Port, ...]:
        """Ports that accept a value."""

    @property
    def outputs(self) -> tuple[Port, ...]:
        """Ports that give a value."""


@dataclass(frozen=True)
class Ports:
    """The ports of a component that need not be built yet, and the declarations of its class on connections.

    starts_on_scan: a shadow whose surface begins with the first scan.
    """

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    is_device: bool = False
    is_shadow: bool = False
    optional_inputs: frozenset[str] = frozenset()
    starts_on_scan: bool = False

    @classmethod
    def of(cls, component: HasPorts) -> Ports:
        """The ports of a component that is built."""
        optional = frozenset(getattr(component, "optional_inputs", ()))
        starts_on_scan = bool(getattr(component, "starts_on_scan", False))
        ports = tuple(component.inputs), tuple(component.outputs)
        return cls(*ports, is_device(component), is_shadow(component), optional, starts_on_scan)


def is_device(component: HasPorts) -> bool:
    """Whether a component acts on or measures something real."""
    return bool(getattr(component, "is_device", False))


def is_shadow(component: HasPorts) -> bool:
    """Whether a component is a model that shadows a device; it supplies outputs that no other component has."""
    return bool(getattr(component, "is_shadow", False))


MEMBERS = ("inputs", "outputs", "initialize", "do_step", "terminate")
"""Members that every component must have."""


@runtime_checkable
class Geometry(Protocol):
    """A part in space as a set of points. Coordinates in metres, origin at the centre of cell (0, 0)."""

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        """True where the point (x, y, z) lies in the part; the three broadcast against each other."""

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        """Intervals of the heights that `contains` accepts over each (x, y): see `inkloop.geometry.contained`."""


@dataclass(frozen=True)
class Ink:
    """Height that a droplet adds to its own cell, each side and each corner neighbour [m] (Lu et al. 2015, Table I)."""

    h1: float = 4.4e-6
    h2: float = 0.6e-6
    h3: float = 0.2e-6

    @property
    def layer_height(self) -> float:
        """Height of a full layer on a wide flat surface [m]: h1 + 4 h2 + 4 h3."""
        return self.h1 + 4.0 * self.h2 + 4.0 * self.h3


@dataclass(frozen=True, eq=False)
class Job:
    """The print job, as every component receives it.

    target_height: (nx, ny) [m]; mask: (nx, ny), the part's cells, over which errors count and droplets may fall;
    inks: one per material; region: where material A belongs (None: one material everywhere);
    passes: 1 or 4, with pass_order and pass_rotation as in LayerDeposition; seed: the component's own stream;
    height_start: (nx, ny) [m], the surface to print on (None: flat), for the printer; a controller is to measure it.
    Raises ValueError, all errors in one sentence, for what no print has: maps of another shape, heights in micrometres.
    """

    nx: int
    ny: int
    pitch: float
    target_height: FloatMap
    mask: BoolMap
    inks: tuple[Ink, ...] = (Ink(),)
    region: Geometry | None = None
    passes: int = 1
    pass_order: int = 1
    pass_rotation: int = 0
    seed: int = 0
    height_start: FloatMap | None = None

    def __post_init__(self) -> None:
        if errors := errors_of_job(self):
            raise ValueError("; ".join(errors))
