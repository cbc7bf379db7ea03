"""Record of a run, layer by layer, by an observer that knows only the layer contract.

Row k belongs to layer k, row 0 to the start surface. A component's outputs give its role: `layer_command` that of the
controller, `layers_printed` of the printer, `layers_scanned` of the profiler, `layers_followed` of a shadow of the
printer; any may be missing. A printer that does not report its surface, as no real one can, is judged by the scans of a
real profiler, else by its shadow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, HasPorts, Job, Port, Status, Values, is_device
from inkloop.contract import (
    CONTROLLER,
    COUNTERS,
    DROP_LEVEL,
    HEIGHT,
    LAYER_UNKNOWN,
    LAYERS_COMPARED,
    LAYERS_FOLLOWED,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    MEASURED_HEIGHT,
    PATTERN,
    PRINTER,
    PROFILER,
    SHADOW,
    SIGNALS,
    STATUS,
    VALID,
)
from inkloop.results.metrics import surface_error
from inkloop.units import S_PER_NS

if TYPE_CHECKING:
    import xarray as xr

COUNTER_ROLES = {
    **{name: str(SIGNALS[name].giver) for name in COUNTERS},
    LAYERS_FOLLOWED: SHADOW,
    LAYERS_COMPARED: SHADOW,
}
"""Sequence number -> role of the component that puts it out."""
LABELS = {(SHADOW, HEIGHT): "shadow_height", (SHADOW, STATUS): "shadow_status"}
"""Ports recorded under another name, because their values never come from a printer."""
NOT_REPRODUCIBLE = frozenset({"solve_time"})
LONG_NAMES = {
    HEIGHT: "surface after the layer",
    "area": "share of each cell that ink covers after the layer",
    MEASURED_HEIGHT: "scan of the layer",
    VALID: "cells of the scan that were measured",
    "estimated_height": "the controller's estimate from the scan of the layer",
    PATTERN: "what was jetted in the layer: 0 none, 1 material A, 2 material B",
    DROP_LEVEL: "drops that each droplet of the layer consists of",
    "time": "time at which the layer was complete",
    "shadow_height": "surface of the model that follows the commanded patterns",
    "shadow_status": "4: grew differently from the model, or could not be compared; 3: so much that the run ended",
    "growth_divergence": "rms over the part of what was scanned to be added less what the model adds",
    "surface_divergence": "rms over the part of scan less model",
    LAYER_UNKNOWN: "the layer was aborted: what of its pattern was jetted is unknown",
    "mean_error": "target minus mean height over the part",
    "mae": "mean absolute error over the part",
    "rms": "root mean square error over the part",
    "std": "standard deviation of the error over the part (population)",
}


@dataclass(frozen=True)
class LayerRow:
    """A finished layer in figures: errors over the part [m], `scalars` reported by the components."""

    layer: int
    time: float
    mean_error: float
    mae: float
    std: float
    scalars: Mapping[str, float]


class Recorder:
    """Observer of a master; `on_layer` receives every finished layer, the start surface included.

    Maps by layer: `height` when it is printed, `measured_height` and `valid` when it is scanned, `pattern`,
    `drop_level` and the scalars of the controller when it is commanded, `estimated_height` when the controller has
    answered its scan. Ports are all that it needs of the components.
    """

    def __init__(
        self, job: Job, components: Mapping[str, HasPorts], on_layer: Callable[[LayerRow], None] | None = None
    ) -> None:
        self._job = job
        self._on_layer = on_layer
        self._roles: dict[str, str] = {}
        self._ports: dict[str, Port] = {}
        self._rows: dict[str, dict[int, NDArray[Any]]] = {}
        self._layer_times: dict[int, float] = {}
        self._seen: dict[str, int] = {}
        self._new_rows: dict[str, NDArray[Any]] = {}
        for counter, role in COUNTER_ROLES.items():
            for name, component in components.items():
                if role not in self._roles and any(port.name == counter for port in component.outputs):
                    self._roles[role] = name
        self._own_ports = {
            role: {port.name: port for port in components[name].outputs} for role, name in self._roles.items()
        }
        self._surface_role, self._surface_port = self._source_of_surface(components)

    @property
    def layers(self) -> int:
        """Number of the last printed layer."""
        return max(self._layer_times, default=0)

    @property
    def scanned(self) -> int:
        """Layer of the last scan, -1 before the first."""
        return self._seen.get(LAYERS_SCANNED, -1)

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Row 0: the start surface; nothing if it resumes from the rows of an earlier part of the run."""
        self._seen = {
            counter: int(outputs[self._roles[role]][counter])
            for counter, role in COUNTER_ROLES.items()
            if role in self._roles
        }
        if self._layer_times:
            return
        if PRINTER in self._roles:
            self._printed(self._seen[LAYERS_PRINTED], time_ns, outputs[self._roles[PRINTER]])
        if SHADOW in self._roles:
            self._followed(LAYERS_FOLLOWED, self._seen[LAYERS_FOLLOWED], time_ns, outputs[self._roles[SHADOW]])
        if self._seen.get(LAYERS_SCANNED, -1) >= 0:
            self._scanned(self._seen[LAYERS_SCANNED], time_ns, outputs[self._roles[PROFILER]])

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Record all values whose sequence number is new."""
        for counter, role in COUNTER_ROLES.items():
            if role not in self._roles:
                continue
            values = outputs[self._roles[role]]
            number = int(values[counter])
            if number == self._seen[counter]:
                if role == CONTROLLER and values.get(STATUS) == Status.DONE:
                    self._keep(role, "estimated_height", number, values)
                continue
            self._seen[counter] = number
            if role == CONTROLLER:
                self._commanded(number, values)
            elif role == PRINTER:
                self._printed(number, time_ns, values)
            elif role == SHADOW:
                self._followed(counter, number, time_ns, values)
            else:
                self._scanned(number, time_ns, values)

    def take_rows(self) -> dict[str, NDArray[Any]]:
        """What was recorded since this was last called, for `put_rows` of a recorder of the same components."""
        rows, self._new_rows = self._new_rows, {}
        return rows

    def put_rows(self, rows: Mapping[str, NDArray[Any]]) -> None:
        """Record what `take_rows` of an earlier part of the run gave; all of its calls in their order."""
        for key, value in rows.items():
            place, _, layer = key.rpartition("/")
            role, _, name = place.partition("/")
            if role == "run":
                self._layer_times[int(layer)] = float(value)
            else:
                self._keep(role, name, int(layer), {name: value})
        self._new_rows = {}

    def dataset(self) -> xr.Dataset:
        """Everything recorded, as labelled arrays with units; layers that were jumped over hold NaN or 0."""
        import xarray as xr

        job, count = self._job, self.layers + 1
        variables: dict[str, xr.Variable] = {
            "target_height": _variable(("x", "y"), job.target_height, "m", "height that the part shall have"),
            "mask": _variable(("x", "y"), job.mask, "1", "cells of the part"),
        }
        for name, rows in self._rows.items():
            port = self._ports[name]
            dims = ("layer", "x", "y")[: 1 + len(port.shape)]
            filled = np.full((count, *port.shape), np.nan if port.dtype.startswith("float") else 0, dtype=port.dtype)
            for layer, value in rows.items():
                if layer < count:
                    filled[layer] = value
            variables[name] = _variable(dims, filled, port.unit, LONG_NAMES.get(name, name.replace("_", " ")))
            if name in NOT_REPRODUCIBLE:
                variables[name].attrs["reproducible"] = "no: wall-clock"
        times = np.array([self._layer_times.get(layer, np.nan) for layer in range(count)])
        variables["time"] = _variable(("layer",), times, "s", LONG_NAMES["time"])
        if HEIGHT not in variables and (surface := self._surface_label()) in variables:
            heights = _carried(variables[surface].values, self._rows[surface])
            variables[HEIGHT] = _variable(("layer", "x", "y"), heights, "m", f"{LONG_NAMES[HEIGHT]}: {surface}")
        if HEIGHT in variables:
            errors = [surface_error(surface, job) for surface in variables[HEIGHT].values]
            for name in ("mean_error", "mae", "rms", "std"):
                values = np.array([getattr(error, name) for error in errors])
                variables[name] = _variable(("layer",), values, "m", LONG_NAMES[name])
        coordinates = {
            "layer": _variable(("layer",), np.arange(count), "1", "layer; 0 is the start surface"),
            "x": _variable(("x",), np.arange(job.nx) * job.pitch, "m", "position along x"),
            "y": _variable(("y",), np.arange(job.ny) * job.pitch, "m", "position along y"),
        }
        return xr.Dataset(variables, coordinates, {"pitch": job.pitch})

    def _commanded(self, number: int, values: Values) -> None:
        for name in (PATTERN, DROP_LEVEL):
            self._keep(CONTROLLER, name, number, values)
        self._keep(CONTROLLER, "estimated_height", number - 1, values)
        self._keep_scalars(CONTROLLER, number, values)

    def _printed(self, number: int, time_ns: int, values: Values) -> None:
        self._layer_times[number] = time_ns * S_PER_NS
        self._new_rows[f"run/time/{number}"] = np.asarray(time_ns * S_PER_NS)
        for name in (HEIGHT, "area"):
            self._keep(PRINTER, name, number, values)
        self._keep_scalars(PRINTER, number, values)
        self._report(PRINTER, number, time_ns, values)

    def _scanned(self, number: int, time_ns: int, values: Values) -> None:
        for name in (MEASURED_HEIGHT, VALID):
            self._keep(PROFILER, name, number, values)
        self._keep_scalars(PROFILER, number, values)
        self._report(PROFILER, number, time_ns, values)

    def _followed(self, counter: str, number: int, time_ns: int, values: Values) -> None:
        """The shadow has deposited a layer, or was compared with a scan; the scan of layer 0 may move its surface."""
        if counter == LAYERS_COMPARED:
            self._keep_scalars(SHADOW, number, values)
            self._keep(SHADOW, STATUS, number, values)
        if number == int(values[LAYERS_FOLLOWED]):
            self._keep(SHADOW, HEIGHT, number, values)
        if counter == LAYERS_FOLLOWED:
            self._report(SHADOW, number, time_ns, values)

    def _report(self, role: str, number: int, time_ns: int, values: Values) -> None:
        """Report a layer when its surface is known."""
        if self._on_layer is None or role != self._surface_role:
            return
        error = surface_error(values[self._surface_port], self._job)
        scalars = {
            name: float(rows[number]) for name, rows in self._rows.items() if number in rows and rows[number].ndim == 0
        }
        self._on_layer(LayerRow(number, time_ns * S_PER_NS, error.mean_error, error.mae, error.std, scalars))

    def _source_of_surface(self, components: Mapping[str, HasPorts]) -> tuple[str, str]:
        """Role and output: the printer, else a profiler that is a device, else the shadow; "" if none."""
        candidates = [(PRINTER, HEIGHT), (SHADOW, HEIGHT), (PROFILER, MEASURED_HEIGHT)]
        if PROFILER in self._roles and is_device(components[self._roles[PROFILER]]):
            candidates.insert(1, candidates.pop())
        known = ((role, port) for role, port in candidates if port in self._own_ports.get(role, {}))
        return next(known, ("", ""))

    def _surface_label(self) -> str:
        return LABELS.get((self._surface_role, self._surface_port), self._surface_port)

    def _keep_scalars(self, role: str, layer: int, values: Values) -> None:
        for name, port in self._own_ports[role].items():
            if port.shape == () and name not in COUNTER_ROLES and name != STATUS:
                self._keep(role, name, layer, values)

    def _keep(self, role: str, name: str, layer: int, values: Values) -> None:
        """Store one value under its name; if two components share a name, the second one is prefixed by its role."""
        port = self._own_ports[role].get(name)
        if port is None or layer < 0:
            return
        label = LABELS.get((role, name), name)
        if self._ports.setdefault(label, port) is not port:
            label = f"{role}_{name}"
            self._ports.setdefault(label, port)
        self._rows.setdefault(label, {})[layer] = self._new_rows[f"{role}/{name}/{layer}"] = np.array(values[name])


def _carried(maps: NDArray[Any], known: Mapping[int, object]) -> NDArray[Any]:
    """Maps by layer, unknown ones as the known one before them: a layer may be printed and not yet scanned."""
    layers = np.arange(len(maps))
    last = np.maximum.accumulate(np.where(np.isin(layers, list(known)), layers, 0))
    carried: NDArray[Any] = maps[last]
    return carried


def _variable(dims: tuple[str, ...], values: NDArray[Any] | FloatMap, unit: str, long_name: str) -> xr.Variable:
    import xarray as xr

    return xr.Variable(dims, values, {"units": str(unit), "long_name": long_name})
