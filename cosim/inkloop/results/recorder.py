"""Record of a run, layer by layer, by an observer that knows only the layer contract.

Row k belongs to layer k, row 0 to the start surface. A component's outputs give its role: `layer_command` that of the
controller, `layers_printed` of the printer, `layers_scanned` of the profiler, `layers_followed` of a shadow of the
printer; any may be missing. A printer that does not report its surface, as no real one can, is judged by the scans of a
real profiler, else by its shadow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import HasPorts, Job, Port, Status, Values, is_device
from inkloop.contract import (
    CONTROLLER,
    COUNTERS,
    DROP_LEVEL,
    HEIGHT,
    LAYER_COMMAND,
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
    STOP_REASON,
    VALID,
)
from inkloop.results.array_file import RUN, Place, keys, packed, scalars
from inkloop.results.attributes import variable
from inkloop.results.layer_maps import LayerMaps
from inkloop.results.metrics import surface_error
from inkloop.results.solid import INK, layer_ink, region_edges
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
STOP = (STOP_REASON, "stop_layer", "stop_transform", "stop_figure")
"""Outputs of a controller that has ended the print; it stands in the row of the layer whose scan it was."""
DROPLETS = ("droplets_a", "droplets_b")
"""Droplets of each ink so far, by a printer that counts them."""
COUNTER_END = 2**31 - 1
"""Where the counter of a printer stays: after 59 full layers of 36 million cells."""
ERRORS = ("mean_error", "mae", "rms", "std")


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
    `drop_level`, `planned_droplets` and the scalars of the controller when it is commanded, `estimated_height` when the
    controller has answered its scan. Scalars stay in memory, maps until `take_rows` hands them over. Of the components,
    only the ports are needed.
    """

    def __init__(
        self, job: Job, components: Mapping[str, HasPorts], on_layer: Callable[[LayerRow], None] | None = None
    ) -> None:
        self._job = job
        self._on_layer = on_layer
        self._roles: dict[str, str] = {}
        self._ports: dict[str, Port] = {}
        self._scalars: dict[str, dict[int, NDArray[Any]]] = {}
        self._layer_times: dict[int, float] = {}
        self._errors: dict[int, NDArray[np.float64]] = {}
        self._of_run: dict[str, dict[int, Any]] = {"time": self._layer_times, "errors": self._errors}
        self._seen: dict[str, int] = {}
        self._new_rows: dict[Place, NDArray[Any]] = {}
        self._commanded_drops = [0, 0]
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
        for counter in (LAYERS_PRINTED, LAYERS_FOLLOWED, LAYERS_SCANNED):
            if self._seen.get(counter, -1) >= 0:
                self._record(counter, time_ns, outputs[self._roles[COUNTER_ROLES[counter]]])

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Record all values whose sequence number is new."""
        for counter, seen in self._seen.items():
            values = outputs[self._roles[COUNTER_ROLES[counter]]]
            if int(values[counter]) != seen:
                self._seen[counter] = int(values[counter])
                self._record(counter, time_ns, values)
            elif counter == LAYER_COMMAND:
                stop = STOP if values.get(STOP_REASON, 0) > 0 else ()
                if stop or values.get(STATUS) == Status.DONE:
                    for name in ("estimated_height", *stop):
                        self._keep(CONTROLLER, name, seen, values)

    def take_rows(self) -> dict[str, NDArray[Any]]:
        """Rows recorded since this was last called, for `put_rows` of a recorder of the same components."""
        rows, self._new_rows = self._new_rows, {}
        return packed(rows)

    def put_rows(self, rows: Mapping[str, NDArray[Any]]) -> None:
        """Record what `take_rows` of an earlier part of the run gave; all of its calls in their order."""
        for (role, name, layer), key in keys(rows):
            if role == RUN:
                self._of_run[name][layer] = rows[key]
            else:
                self._label(role, name)
        for (role, name, layer), value in scalars(rows):
            if role == RUN:
                self._of_run[name][layer] = value
            elif label := self._label(role, name):
                self._scalars.setdefault(label, {})[layer] = value

    def table(self) -> xr.Dataset:
        """Everything recorded but the maps by layer, with units; layers that were jumped over hold NaN or 0."""
        import xarray as xr

        job, count = self._job, self.layers + 1
        variables: dict[str, xr.Variable] = {
            "target_height": variable("target_height", ("x", "y"), job.target_height, "m"),
            "mask": variable("mask", ("x", "y"), job.mask, "1"),
        }
        for name, edges in region_edges(job).items():
            variables[name] = variable(name, ("interval", "x", "y"), edges, "m")
        for name, rows in self._scalars.items():
            port = self._ports[name]
            dtype = np.result_type(port.dtype, *{value.dtype for value in rows.values()})
            filled = np.full(count, np.nan if port.dtype.startswith("float") else 0, dtype=dtype)
            for layer, value in rows.items():
                if layer < count:
                    filled[layer] = value
            variables[name] = variable(name, ("layer",), filled, port.unit, giver=self._giver(port))
        times = np.array([self._layer_times.get(layer, np.nan) for layer in range(count)])
        variables["time"] = variable("time", ("layer",), times, "s")
        if self._errors:
            unknown = np.full(len(ERRORS), np.nan)
            errors = [self._errors.get(0, unknown)]
            for layer in range(1, count):
                errors.append(self._errors.get(layer, errors[-1] if self._is_carried else unknown))
            for name, values in zip(ERRORS, np.transpose(errors), strict=True):
                variables[name] = variable(name, ("layer",), values.copy(), "m")
        coordinates = {
            "layer": variable("layer", ("layer",), np.arange(count), "1"),
            "x": variable("x", ("x",), np.arange(job.nx) * job.pitch, "m"),
            "y": variable("y", ("y",), np.arange(job.ny) * job.pitch, "m"),
        }
        if "region_bottom" in variables:
            intervals = np.arange(variables["region_bottom"].shape[0])
            coordinates["interval"] = variable("interval", ("interval",), intervals, "1")
        return xr.Dataset(variables, coordinates, {"pitch": job.pitch})

    def maps(self, taken: Iterable[Mapping[str, NDArray[Any]]] = ()) -> LayerMaps:
        """All maps by layer; taken: what `take_rows` gave, in its order."""
        job, ports = self._job, {label: port for label, port in self._ports.items() if port.shape}
        empty = {
            label: variable(label, (), np.zeros((), port.dtype), port.unit, giver=self._giver(port))
            for label, port in ports.items()
        }
        if self._is_carried:
            empty[HEIGHT] = variable(HEIGHT, (), 0.0, "m")
            empty[HEIGHT].attrs["source"] = self._surface_label()
        in_two_inks = job.region is not None and {HEIGHT, PATTERN} <= empty.keys()
        if in_two_inks:
            empty[INK] = variable(INK, (), np.int8(0), "1")
        variables = {name: (each.dtype, each.attrs) for name, each in empty.items()}
        rows = self._with_derived(chain(taken, [packed(self._new_rows)]), in_two_inks)
        return LayerMaps((self.layers + 1, job.nx, job.ny), variables, rows, job)

    def dataset(self) -> xr.Dataset:
        """Everything recorded whose maps `take_rows` has not handed over, as labelled arrays with units."""
        return self.maps().added_to(self.table())

    @property
    def _is_carried(self) -> bool:
        """Whether the surface is that of a scan or a shadow, which lacks layers: those keep the one before them."""
        return self._surface_label() in self._ports and self._surface_label() != HEIGHT

    def _with_derived(
        self, parts: Iterable[Mapping[str, NDArray[Any]]], in_two_inks: bool
    ) -> Iterator[tuple[str, int, NDArray[Any]]]:
        """Recorded maps, the surface where no printer reports one, and the ink of each layer."""
        carried = self._surface_label() if self._is_carried else ""
        known, after = np.full((self._job.nx, self._job.ny), np.nan), 0
        for part in parts:
            for (role, name, layer), key in keys(part):
                label = "" if role == RUN else self._label(role, name)
                if not label or not self._ports[label].shape:
                    continue
                map_ = part[key]
                yield label, layer, map_
                if label == carried:
                    yield from ((HEIGHT, between, known) for between in range(after, layer))
                    yield HEIGHT, layer, map_
                    known, after = map_, layer + 1
                if in_two_inks and label == PATTERN and layer > 0:
                    yield INK, layer, layer_ink(map_, self._job.inks)
        if carried:
            yield from ((HEIGHT, layer, known) for layer in range(after, self.layers + 1))

    def _record(self, counter: str, time_ns: int, values: Values) -> None:
        """Keep what the new value of a counter stands for, under its layer."""
        role, number = COUNTER_ROLES[counter], int(values[counter])
        if role == CONTROLLER:
            self._commanded(number, values)
        elif role == SHADOW:
            self._followed(counter, number, values)
        else:
            if role == PRINTER:
                self._keep_of_run("time", number, np.asarray(time_ns * S_PER_NS))
            for name in (HEIGHT, "area") if role == PRINTER else (MEASURED_HEIGHT, VALID):
                self._keep(role, name, number, values)
            self._keep_scalars(role, number, values)
        if counter in (LAYERS_PRINTED, LAYERS_SCANNED, LAYERS_FOLLOWED):
            self._report(role, number, time_ns)

    def _commanded(self, number: int, values: Values) -> None:
        if PATTERN in values:
            pattern = values[PATTERN]
            drops = np.broadcast_to(values.get(DROP_LEVEL, np.int32(1)), pattern.shape)
            self._commanded_drops = [int(drops.sum(where=pattern == ink, dtype=np.int64)) for ink in (1, 2)]
        for name in (PATTERN, DROP_LEVEL, "planned_droplets"):
            self._keep(CONTROLLER, name, number, values)
        self._keep(CONTROLLER, "estimated_height", number - 1, values)
        self._keep_scalars(CONTROLLER, number, values)

    def _followed(self, counter: str, number: int, values: Values) -> None:
        """The shadow has deposited a layer, or was compared with a scan; the scan of layer 0 may move its surface."""
        if counter == LAYERS_COMPARED:
            self._keep_scalars(SHADOW, number, values)
            self._keep(SHADOW, STATUS, number, values)
        if number == int(values[LAYERS_FOLLOWED]):
            self._keep(SHADOW, HEIGHT, number, values)

    def _report(self, role: str, number: int, time_ns: int) -> None:
        """Report a layer when its surface is known."""
        if self._on_layer is None or role != self._surface_role:
            return
        mean, mae, _, std = map(float, self._errors[number])
        scalars = {name: float(rows[number]) for name, rows in self._scalars.items() if number in rows}
        self._on_layer(LayerRow(number, time_ns * S_PER_NS, mean, mae, std, scalars))

    def _source_of_surface(self, components: Mapping[str, HasPorts]) -> tuple[str, str]:
        """Role and output: the printer, else a profiler that is a device, else the shadow; "" if none."""
        candidates = [(PRINTER, HEIGHT), (SHADOW, HEIGHT), (PROFILER, MEASURED_HEIGHT)]
        if PROFILER in self._roles and is_device(components[self._roles[PROFILER]]):
            candidates.insert(1, candidates.pop())
        known = ((role, port) for role, port in candidates if port in self._own_ports.get(role, {}))
        return next(known, ("", ""))

    def _surface_label(self) -> str:
        return LABELS.get((self._surface_role, self._surface_port), self._surface_port)

    def _giver(self, port: Port) -> str:
        return next((role for role, ports in self._own_ports.items() if ports.get(port.name) is port), "")

    def _keep_scalars(self, role: str, layer: int, values: Values) -> None:
        for name, port in self._own_ports[role].items():
            if port.shape == () and name not in COUNTER_ROLES and name != STATUS:
                self._keep(role, name, layer, values)

    def _keep(self, role: str, name: str, layer: int, values: Values) -> None:
        """Store one value under its name, and the errors of a surface."""
        label = self._label(role, name)
        if not label or layer < 0:
            return
        place = Place(role, name, layer)
        value = self._new_rows[place] = np.array(values[name])
        if not value.shape:
            value = self._new_rows[place] = self._counted_on(label, layer, value)
            self._scalars.setdefault(label, {})[layer] = value
        if (role, name) == (self._surface_role, self._surface_port):
            error = surface_error(value, self._job)
            self._keep_of_run("errors", layer, np.array([getattr(error, each) for each in ERRORS]))

    def _counted_on(self, label: str, layer: int, value: NDArray[Any]) -> NDArray[Any]:
        """Droplets so far beyond the end of the printer's counter, which stays there: those commanded are added."""
        if label not in DROPLETS or value < COUNTER_END:
            return value
        before = int(self._scalars.get(label, {}).get(layer - 1, 0))
        return np.asarray(max(COUNTER_END, before + self._commanded_drops[DROPLETS.index(label)]), np.int64)

    def _keep_of_run(self, name: str, layer: int, value: NDArray[np.float64]) -> None:
        self._of_run[name][layer] = self._new_rows[Place(RUN, name, layer)] = value

    def _label(self, role: str, name: str) -> str:
        """The name in the dataset; if two components share one, the second is prefixed by its role. "" for no port."""
        port = self._own_ports[role].get(name)
        if port is None:
            return ""
        label = LABELS.get((role, name), name)
        if self._ports.setdefault(label, port) is not port:
            label = f"{role}_{name}"
            self._ports.setdefault(label, port)
        return label
