"""A scenario: one TOML file that defines the part, the components, and the end of the run."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import ValidationError
from tomlkit.exceptions import TOMLKitError

from inkloop.component import Component, Job, Ports
from inkloop.components import catalog
from inkloop.components.kind import Checked
from inkloop.course.events import Event
from inkloop.errors import OFFERED_MAX, ScenarioError, nearest
from inkloop.files import TomlError, read_toml_text, toml_tables
from inkloop.fmu.bus import BusLink
from inkloop.geometry import Columns
from inkloop.master.wiring import Connection
from inkloop.scenario import packaged
from inkloop.scenario.footprint import CHECK_HEIGHT, Footprint
from inkloop.scenario.loop import Loop
from inkloop.scenario.overrides import apply_overrides
from inkloop.scenario.validation import checked_options, errors_of_invalid_file, part_errors
from inkloop.tables.html import html_table
from inkloop.tables.ink_file import merge_ink_file, names_ink_file
from inkloop.tables.job import job_of, target_of
from inkloop.tables.messages import sentence
from inkloop.tables.schema import ComponentTable, ScenarioFile
from inkloop.tables.shapes import PartError, PartTable, Solid
from inkloop.units import MM_PER_M, UM_PER_M

__all__ = ["Scenario"]


@dataclass(frozen=True)
class Scenario:
    """A valid scenario; `text` is the file as run, overrides included, `solid` its part."""

    source: str
    text: str
    tables: ScenarioFile
    solid: Solid = field(repr=False, compare=False)
    _loop: Loop = field(repr=False, compare=False)
    _variants: Mapping[str, Loop] = field(repr=False, compare=False)
    _job: Callable[[str], Job] = field(repr=False, compare=False)

    @classmethod
    def load(
        cls, path: Path | str, overrides: Mapping[str, Any] | None = None, *, source: Path | str | None = None
    ) -> Scenario:
        """Read a scenario file, or the one of inkloop that has this name. Raises ScenarioError with all its errors.

        overrides: values that replace those of the file, by dotted key, {"components.controller.alpha": 0.5}, or nested
        as the tables are; source: the file that `path` is a copy of, relative to which its FMUs are named.
        """
        path = packaged.resolve(Path(path))
        source = str(source or path)
        try:
            text = read_toml_text(path)
        except FileNotFoundError as error:
            there = [str(other) for other in sorted(path.parent.glob("*.toml"))]
            known = nearest(str(path), there) if there else "no scenario is in that folder"
            raise ScenarioError(source, [f"cannot be read: {error.strerror}; {known}"]) from error
        except IsADirectoryError as error:
            from inkloop.results.made_folder import made_folder

            there = [other.name for other in sorted(path.glob("*.toml"))]
            known = f"a scenario in it: {', '.join(there[:OFFERED_MAX])}" if there else "a scenario file (.toml)"
            raise ScenarioError(source, [made_folder(path) or f"is a folder; name {known}"]) from error
        except OSError as error:
            raise ScenarioError(source, [f"cannot be read: {error.strerror}"]) from error
        except TomlError as error:
            raise ScenarioError(source, [str(error)]) from error
        return cls.of_text(text, source, overrides)

    @classmethod
    def of_text(cls, text: str, source: str, overrides: Mapping[str, Any] | None = None) -> Scenario:
        """The scenario of a text; files that it names are relative to `source`. Raises ScenarioError."""
        try:
            raw = toml_tables(text)
            if "scenario" in raw and "components" not in raw:
                raise ScenarioError(source, [f"is a study; `inkloop sweep {source}` prints it"])
            if not overrides and not names_ink_file(raw):
                return cls._from_tables(source, text, raw, [])
            document = tomlkit.parse(text)
        except TomlError as error:
            raise ScenarioError(source, [str(error)]) from error
        except TOMLKitError as error:
            raise ScenarioError(source, [f"is not TOML: {error}"]) from error
        errors = apply_overrides(document, overrides or {})
        errors += merge_ink_file(document, Path(source).parent)
        return cls._from_tables(source, tomlkit.dumps(document), document.unwrap(), errors)

    @classmethod
    def _from_tables(cls, source: str, text: str, raw: dict[str, Any], errors: list[str]) -> Scenario:
        folder = Path(source).parent
        try:
            tables = ScenarioFile.model_validate(raw)
        except ValidationError as error:
            errors += [sentence(detail, ScenarioFile) for detail in error.errors()]
            raise ScenarioError(source, errors + errors_of_invalid_file(raw, folder)) from error
        if misnamed := [
            f'components."{name}" has {"a dot, which separates it from its ports" if name else "no name"}; rename it'
            for name in tables.components
            if not name or "." in name
        ]:
            raise ScenarioError(source, errors + misnamed + errors_of_invalid_file(raw, folder))
        is_formula = isinstance(tables.part, PartTable)  # a formula takes no memory; other parts are laid over the grid
        too_large = [] if is_formula else list(Footprint.of(tables, 0.0).memory_errors())
        try:
            solid = None if too_large else tables.part.solid(tables.grid, folder)
        except PartError as error:
            errors += [f"part.{wrong}" for wrong in error.errors]
            raise ScenarioError(source, errors + errors_of_invalid_file(raw, folder)) from error
        if solid is None or (too_large := list(Footprint.of(tables, solid.shape.height).memory_errors())):
            raise ScenarioError(source, errors + too_large + errors_of_invalid_file(raw, folder))
        target = target_of(tables, solid)
        job = cache(partial(job_of, tables, target))
        errors += part_errors(tables, solid, target)
        try:
            job("")
        except ValueError as error:
            errors.append(f"{error}{'; check [substrate]' if 'height_start' in str(error) else CHECK_HEIGHT}")
            raise ScenarioError(source, errors + errors_of_invalid_file(raw, folder)) from error

        def checked(place: str, components: Mapping[str, ComponentTable]) -> dict[str, Checked]:
            made = {name: checked_options(table, job(name), folder) for name, table in components.items()}
            errors.extend(f"{place}.{name}.{wrong}" for name, part in made.items() for wrong in part.errors)
            return made

        own = checked("components", tables.components)
        compared = {
            name: checked(f"compare.{name}.components", other.components) for name, other in tables.compare.items()
        }
        for name, other in tables.compare.items():
            unknown = [key for key in other.components if key not in tables.components]
            errors += [
                f"compare.{name}.components.{key} replaces nothing: {nearest(key, tables.components)}"
                for key in unknown
            ]
        are_checked = not errors
        loop = Loop.of(tables, tables.components, own)
        errors += loop.errors
        variants = {}
        for name, other in tables.compare.items() if are_checked else ():
            variants[name] = Loop.of(tables, {**tables.components, **other.components}, {**own, **compared[name]})
            errors += [f"compare.{name}: {wrong}" for wrong in variants[name].errors if wrong not in loop.errors]
        if errors:
            raise ScenarioError(source, errors)
        return cls(source, text, tables, solid, loop, variants, job)

    def variant(self, name: str) -> Scenario:
        """The scenario of `[compare.NAME]`: same job, same seed, other components."""
        components = {**self.tables.components, **self.tables.compare[name].components}
        changes = {"label": name, "components": components, "compare": {}, "literature": {}}
        tables = self.tables.model_copy(update=changes)
        text = tomlkit.dumps(tables.model_dump(exclude_none=True))
        return Scenario(self.source, text, tables, self.solid, self._variants[name], {}, self._job)

    def job(self, component: str = "") -> Job:
        """The job of a component, the same object at every call."""
        return self._job(component)

    def options(self, component: str) -> dict[str, Any]:
        """The options of a component, with the files that they name as paths from the working directory."""
        table = self.tables.components[component]
        return catalog.resolve_paths(table.kind, table.options, Path(self.source).parent)

    @property
    def footprint(self) -> Footprint:
        """Memory, disk space and time of the print."""
        return Footprint.of(self.tables, self.solid.shape.height, int(self.job().mask.sum()))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for a user before a print, one sentence each."""
        of_part = (f"part: {remark}" for remark in self.solid.remarks)
        return (*of_part, *self.tables.ink.remarks, *self._loop.notes, *self.footprint.warnings())

    @property
    def part_sha256(self) -> str | None:
        """Of the columns of a part that comes from files; None for a formula."""
        shape = self.solid.shape
        if not isinstance(shape, Columns):
            return None
        found = hashlib.sha256()
        for columns in (shape, self.solid.region):
            if columns is not None:
                found.update(columns.offsets.tobytes() + columns.bottoms.tobytes() + columns.tops.tobytes())
        return found.hexdigest()

    @property
    def foreign_fmus(self) -> list[str]:
        """The components, comparison runs included, that run an FMU of others."""
        groups = {"components": self.tables.components}
        groups |= {f"compare.{name}.components": other.components for name, other in self.tables.compare.items()}
        return [
            f"{place}.{name}"
            for place, components in groups.items()
            for name, table in components.items()
            if catalog.is_foreign_fmu(table.kind, table.options)
        ]

    @property
    def ports(self) -> Mapping[str, Ports]:
        """The ports of the components in file order."""
        return self._loop.ports

    @property
    def buses(self) -> list[BusLink]:
        """The buses between two components."""
        return self._loop.buses

    @property
    def connections(self) -> list[Connection]:
        """The connections of the file and those of the layer contract."""
        return self._loop.connections

    @property
    def events(self) -> list[Event]:
        """The events in the order of the file."""
        return self._loop.events

    def _repr_html_(self) -> str:
        """Part, grid and components, for notebooks."""
        grid, job = self.tables.grid, self.job()
        side = " x ".join(f"{count * grid.pitch * MM_PER_M:.3g}" for count in (grid.nx, grid.ny))
        rows = {
            "file": self.source,
            "grid": f"{grid.nx} x {grid.ny} cells, {side} mm",
            "part": f"{int(job.mask.sum())} cells, {job.target_height.max() * UM_PER_M:.4g} µm high",
            "inks": str(len(job.inks)),
        }
        for name, table in self.tables.components.items():
            rows[name] = ", ".join((table.kind, *(f"{key} = {value!r}" for key, value in table.options.items())))
        rows |= {"events": "; ".join(map(str, self.events))} if self.events else {}
        return html_table(self.tables.title, rows | {"seed": str(self.tables.seed)})

    def build(self, folder: Path | None = None) -> dict[str, Component]:
        """The components in file order, for the caller to terminate. Raises FmuError.

        folder: of the run, where devices log the traffic of their bus; no bus is opened yet.
        """
        return self._loop.build(self.tables.bench.found_from(Path(self.source).parent), folder)
