"""A scenario: one TOML file that says what is printed, by which components, and when the run ends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from pydantic import ValidationError
from tomlkit.exceptions import TOMLKitError

from inkloop.component import Component, Job
from inkloop.components import catalog
from inkloop.components.devices import Bench
from inkloop.errors import ScenarioError
from inkloop.geometry import cell_centers
from inkloop.master.events import Event
from inkloop.master.wiring import Connection, check, contract_connections
from inkloop.scenario.events import read_events
from inkloop.scenario.validation import component_faults, component_of, end_faults, faultless, mix_faults, shadow_faults
from inkloop.suggest import nearest
from inkloop.tables import ink_file
from inkloop.tables.job import job_of
from inkloop.tables.messages import sentence
from inkloop.tables.quantities import read_quantities
from inkloop.tables.schema import ComponentTable, ConnectionTable, ScenarioFile


@dataclass(frozen=True)
class Scenario:
    """A valid scenario; `text` is the file as run, overrides included."""

    source: str
    text: str
    tables: ScenarioFile

    @classmethod
    def load(cls, path: Path | str, overrides: Iterable[str] = (), *, source: Path | str | None = None) -> Scenario:
        """Read `path` with `key=value` overrides. Raises ScenarioError with every fault of the file.

        source: the file that `path` is a copy of; its FMUs stand beside it.
        """
        source = str(source or path)
        try:
            text = Path(path).read_text(encoding="utf-8")
        except OSError as error:
            raise ScenarioError(source, [f"cannot be read: {error.strerror}"]) from error
        except UnicodeDecodeError as error:
            raise ScenarioError(source, [f"is not TOML: {error}"]) from error
        return cls.of_text(text, source, overrides)

    @classmethod
    def of_text(cls, text: str, source: str, overrides: Iterable[str] = ()) -> Scenario:
        """The scenario of a text; what it names stands beside `source`. Raises ScenarioError."""
        try:
            document = tomlkit.parse(text)
        except TOMLKitError as error:
            raise ScenarioError(source, [f"is not TOML: {error}"]) from error
        faults = [fault for override in overrides if (fault := apply_override(document, override))]
        faults += ink_file.put_in(document, Path(source).parent)
        return cls._from_tables(source, tomlkit.dumps(document), document.unwrap(), faults)

    @classmethod
    def _from_tables(cls, source: str, text: str, raw: dict[str, Any], faults: list[str]) -> Scenario:
        try:
            tables = ScenarioFile.model_validate(raw)
        except ValidationError as error:
            faults += [sentence(detail, ScenarioFile) for detail in error.errors()]
            faults += component_faults(raw, Path(source).parent)
            raise ScenarioError(source, faults) from error
        scenario = cls(source, text, tables)
        faults += scenario._faults()
        if faults:
            raise ScenarioError(source, faults)
        return scenario

    def variant(self, name: str) -> Scenario:
        """The scenario of `[compare.NAME]`: same job, same seed, other components."""
        components = {**self.tables.components, **self.tables.compare[name].components}
        changes = {"label": name, "components": components, "compare": {}, "literature": {}}
        tables = self.tables.model_copy(update=changes)
        return Scenario(self.source, tomlkit.dumps(tables.model_dump(exclude_none=True)), tables)

    def job(self, component: str = "") -> Job:
        """The job as `component` is told it."""
        return job_of(self.tables, component)

    def options(self, component: str) -> dict[str, Any]:
        """The options of a component, the files that they name as they are found from here."""
        return self._options(self.tables.components[component])

    @property
    def foreign_fmus(self) -> list[str]:
        """The components, comparison runs included, that run an FMU of others."""
        places = self._all_components()
        return [place for place, table in places if catalog.is_foreign_fmu(table.kind, table.options)]

    def build(self, folder: Path | None = None) -> tuple[dict[str, Component], list[Connection]]:
        """Components in file order and their checked connections. The caller terminates the components.

        folder: of the run, where devices log the traffic of their bus; no bus is opened yet. Raises ScenarioError, also
        with the faults of the events.
        """
        components: dict[str, Component] = {}
        bench = Bench(self.tables.bench, folder)
        try:
            for name, table in self.tables.components.items():
                components[name] = catalog.make(table.kind, self.job(name), self._options(table), bench)
            connections, faults = self._connect(components)
            if faults := faults + self._read_events(components)[1]:
                raise ScenarioError(self.source, faults)
        except BaseException:
            for component in components.values():
                component.terminate()
            raise
        return components, connections

    def events(self, components: Mapping[str, Component]) -> list[Event]:
        """The events of the file for the components that `build` has made."""
        return self._read_events(components)[0]

    def _read_events(self, components: Mapping[str, Component]) -> tuple[list[Event], list[str]]:
        counts = {name: table.options.get("nozzle_pitch") for name, table in self.tables.components.items()}
        nozzle_pitch = {name: count for name, count in counts.items() if isinstance(count, int)}
        unmade = self.tables.components.keys() - components.keys()
        return read_events(self.tables.events, components, nozzle_pitch, self.tables.grid.pitch, unmade)

    def _options(self, table: ComponentTable) -> dict[str, Any]:
        """The options of a component; a file or folder that they name stands beside the scenario."""
        return catalog.beside(table.kind, table.options, Path(self.source).parent)

    def _connect(self, components: Mapping[str, Component]) -> tuple[list[Connection], list[str]]:
        faults: list[str] = []
        explicit = [
            _connection(f"connections.[{number}]", table, components, faults)
            for number, table in enumerate(self.tables.connections)
        ]
        taken = {connection.target for connection in explicit}
        wires = [wire for wire in contract_connections(components) if wire.target not in taken]
        if mixed := mix_faults(components):  # what they leave unconnected is no fault of its own
            return [], faults + mixed
        connections = explicit + wires
        return connections, faults + check(components, connections) + shadow_faults(components, connections)

    def _faults(self) -> list[str]:
        faults = self._part_faults()
        for place, table in self._all_components():
            job = self.job(place)
            if not job.mask.any():  # a fault already named; the components are checked all the same
                job = replace(job, mask=~job.mask)
            faults += [f"{place}.{fault}" for fault in catalog.faults(table.kind, job, self._options(table))]
        for name in self.tables.compare:
            unknown = [key for key in self.tables.compare[name].components if key not in self.tables.components]
            faults += [
                f"compare.{name}.components.{key} replaces nothing: {nearest(key, self.tables.components)}"
                for key in unknown
            ]
        return faults + (self._end_faults() if faults else self._wiring_faults())

    def _end_faults(self) -> list[str]:
        """What connections and events name that is not there, as far as the components can be made."""
        parts = {name: (table.kind, self.job(name), self._options(table))
                 for name, table in self.tables.components.items()}  # fmt: skip
        connections = [(wire.source, wire.target) for wire in self.tables.connections]
        ends = [*(event.port for event in self.tables.events), *(end for both in connections for end in both)]
        with faultless(parts, {component_of(end) for end in ends}) as components:
            wrong = end_faults(components, [name for name in parts if name not in components], connections)
            return wrong + self._read_events(components)[1]

    def _wiring_faults(self) -> list[str]:
        try:
            components, _ = self.build()
        except ScenarioError as error:
            return list(error.faults)
        for component in components.values():
            component.terminate()
        return []

    def _part_faults(self) -> list[str]:
        job, grid = self.job(), self.tables.grid
        if not job.mask.any():
            return ["part covers no cell of the grid; make it larger, move it, or enlarge grid.nx and grid.ny"]
        if self.tables.support is not None:
            return []
        x, y = cell_centers(grid.nx + 2, grid.ny + 2, grid.pitch)
        around = self.tables.part.geometry(grid).contains(x - grid.pitch, y - grid.pitch, np.zeros_like(x))
        around[1:-1, 1:-1] = False
        if around.any():
            return [
                f"part reaches beyond the grid of {grid.nx} x {grid.ny} cells; enlarge grid.nx and grid.ny "
                "(leave 2 empty cells around the part) or make it smaller"
            ]
        return []

    def _all_components(self) -> Iterable[tuple[str, ComponentTable]]:
        for name, table in self.tables.components.items():
            yield f"components.{name}", table
        for variant, comparison in self.tables.compare.items():
            for name, table in comparison.components.items():
                yield f"compare.{variant}.components.{name}", table


def _connection(
    place: str, table: ConnectionTable, components: Mapping[str, Component], faults: list[str]
) -> Connection:
    """The connection of a table, its offset in the unit of its input; `faults` gets what is wrong with the keys."""
    component, _, name = table.target.partition(".")
    inputs = {port.name: port for port in components[component].inputs} if component in components else {}
    unit = inputs[name].unit if name in inputs else "1"
    values, wrong = read_quantities(table.quantities, {"offset": unit}, ConnectionTable.model_fields)
    key, offset = values.get("offset", ("offset", 0.0))
    if isinstance(offset, bool) or not isinstance(offset, int | float) or not math.isfinite(offset):
        wrong.append(f"{key} is {table.quantities[key]!r}; expected a finite number")
        offset = 0.0
    faults += [f"{place}.{fault}" for fault in wrong]
    return Connection(table.source, table.target, table.gain, float(offset))


def apply_override(document: tomlkit.TOMLDocument, override: str) -> str | None:
    """Set one `table.key=value` in the document; a sentence if it cannot be."""
    path, separator, text = override.partition("=")
    keys = [key.strip() for key in path.split(".")]
    if not separator or not all(keys):
        return f"--set {override}: expected key=value, e.g. --set components.controller.alpha=0.5"
    try:
        value: Any = tomlkit.value(text.strip())
    except TOMLKitError:
        value = text.strip()
    components = document.get("components", {})
    if keys[0] == "components" and len(keys) > 2 and keys[1] not in components and keys[2:] != ["kind"]:
        known = [f"components.{name}" for name in components]
        return f"--set {override}: there is no components.{keys[1]}; {nearest(f'components.{keys[1]}', known)}"
    table: Any = document
    for key in keys[:-1]:
        if key not in table:
            table[key] = tomlkit.table()
        table = table[key]
        if not isinstance(table, Mapping):
            return f"--set {override}: {key} is not a table"
    table[keys[-1]] = value
    return None
