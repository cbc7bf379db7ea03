"""A study: the file as tables, the scenario that it changes, and the points to print."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from inkloop.components import devices
from inkloop.errors import ScenarioError
from inkloop.files import TomlError, read_toml_text, toml_tables
from inkloop.scenario.file import Scenario
from inkloop.scenario.packaged import classes_from
from inkloop.suggest import near, nearest
from inkloop.tables.messages import sentence
from inkloop_lab.sweep.distributions import KINDS, Distribution, distribution
from inkloop_lab.sweep.override_check import errors_of_values
from inkloop_lab.sweep.sampling import BALANCED, LEAST, SOBOL_INDICES, Samples, sampled
from inkloop_lab.sweep.tables import SampleTable, StudyFile

PRINTS_MAX = 1_000_000
"""Prints of a study; more would take a processor at least a day even for the smallest part."""


@dataclass(frozen=True)
class Study:
    """A valid study. axes: key -> its values, whose product is printed; samples: points of `[sample]`.

    search: key -> values that `[optimise]` may choose; then there are neither axes nor samples. text: of the file.
    """

    path: Path
    text: str
    tables: StudyFile
    scenario: Scenario = field(repr=False, compare=False)
    axes: Mapping[str, Sequence[Any]]
    samples: Samples | None
    search: Mapping[str, Distribution]

    @classmethod
    def load(cls, path: Path) -> Study:
        """Read a study file. Raises ScenarioError with every error of it and of the values that it gives."""
        try:
            text = read_toml_text(path)
            raw = toml_tables(text)
        except OSError as error:
            raise ScenarioError(str(path), [f"cannot be read: {error.strerror}; expected a study file"]) from error
        except TomlError as error:
            raise ScenarioError(str(path), [str(error)]) from error
        if "components" in raw:
            table = 'title = "..." and scenario = "..."'
            raise ScenarioError(str(path), [f"is a scenario; name it in a study file, which has {table}"])
        errors: list[str] = []
        axes = dict(_axes(raw.get("vary", {}), errors))
        spreads = dict(_distributions(raw, errors))
        tables: StudyFile | None = None
        try:
            tables = StudyFile.model_validate(raw)
            errors += _errors_of_keys(tables, axes, spreads)
        except ValidationError as error:
            errors += [sentence(detail, StudyFile) for detail in error.errors()]
        scenario = _scenario(raw.get("scenario"), path, axes, spreads, errors)
        if errors or tables is None or scenario is None:
            raise ScenarioError(str(path), list(dict.fromkeys(errors)))
        if tables.optimise:
            choices = {key: Distribution("choice", tuple(values)) for key, values in axes.items()}
            return cls(path, text, tables, scenario, {}, None, {**choices, **spreads})
        samples = None
        if tables.sample and tables.sample.method and tables.sample.points:
            samples = sampled(tables.sample.method, tables.sample.points, tables.sample.seed, spreads)
        study = cls(path, text, tables, scenario, axes, samples, {})
        if study.count * tables.seeds.count > PRINTS_MAX:
            raise ScenarioError(
                str(path), [f"has {study.count} points of {tables.seeds.count} prints; at most {PRINTS_MAX} prints"]
            )
        return study

    @property
    def title(self) -> str:
        """Names of tables and pictures."""
        return self.tables.title or self.scenario.tables.title

    @property
    def shape(self) -> dict[str, int]:
        """Dimension -> its length, without the seeds: the keys of `[vary]`, then `sample`, or `trial`."""
        if self.tables.optimise:
            return {"trial": self.tables.optimise.trials}
        shape = {key: len(values) for key, values in self.axes.items()}
        return shape | ({"sample": len(self.samples)} if self.samples else {})

    @property
    def count(self) -> int:
        """Points."""
        count = 1
        for length in self.shape.values():
            count *= length
        return count

    @property
    def first_seed(self) -> int:
        """The seed of the first print of each point."""
        first = self.tables.seeds.first
        return self.scenario.tables.seed if first is None else first

    def points(self) -> Iterator[dict[str, Any]]:
        """The overrides of each point, in the order of `shape`; none of `[optimise]`, which finds them itself."""
        if self.tables.optimise:
            return
        for values in itertools.product(*self.axes.values()):
            chosen = dict(zip(self.axes, values, strict=True))
            if self.samples is None:
                yield chosen
            else:
                yield from ({**chosen, **self.samples.overrides(number)} for number in range(len(self.samples)))


def _axes(vary: Any, errors: list[str]) -> Iterator[tuple[str, list[Any]]]:
    for key, values in _leaves(vary) if isinstance(vary, Mapping) else ():
        place = f'vary."{key}"'
        if not isinstance(values, list) or not values:
            errors.append(f"{place} is {values!r}; expected a list of values")
        elif len({repr(value) for value in values}) < len(values):
            errors.append(f"{place} is {values!r}; expected each value once")
        else:
            yield key, values


def _distributions(raw: dict[str, Any], errors: list[str]) -> Iterator[tuple[str, Distribution]]:
    """The distributions of `[sample]`, which are taken out of the table: only its own keys stay there."""
    sample = raw.get("sample")
    if not isinstance(sample, Mapping):
        return
    own = {key: value for key, value in sample.items() if key in SampleTable.model_fields}
    raw["sample"] = own
    for key, table in _leaves({key: value for key, value in sample.items() if key not in own}, of_tables=True):
        place = f'sample."{key}"'
        if not isinstance(table, dict):
            hint = nearest(key, SampleTable.model_fields) if near(key, SampleTable.model_fields) else ""
            expected = f"expected a distribution, such as {{ uniform = [0.0, 1.0] }}: {', '.join(KINDS)}"
            errors.append(f"{place} is {table!r}; {hint or expected}")
            continue
        try:
            yield key, distribution(table)
        except ValueError as error:
            errors.append(f"{place} {error}")


def _leaves(tables: Mapping[str, Any], *, of_tables: bool = False, path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted key and value of what is no table; of_tables: a table that holds no other one is a value too."""
    for key, value in tables.items():
        is_table = isinstance(value, Mapping) and not (
            of_tables and not any(isinstance(each, Mapping) for each in value.values())
        )
        if is_table:
            yield from _leaves(value, of_tables=of_tables, path=f"{path}{key}.")
        else:
            yield f"{path}{key}", value


def _errors_of_keys(tables: StudyFile, axes: Mapping[str, Any], spreads: Mapping[str, Distribution]) -> Iterator[str]:
    """Errors of the keys of the study: missing ones, and ones given twice."""
    sample, keys = tables.sample, [*axes, *spreads]
    for key in dict.fromkeys(keys):
        if keys.count(key) > 1:
            yield f'"{key}" is in vary and in sample; keep one of them'
        if inside := [other for other in keys if other.startswith(f"{key}.")]:
            yield f'"{key}" holds "{inside[0]}"; keep one of them'
    if "seed" in keys:
        yield '"seed" is what [seeds] gives to each print; leave it out'
    if tables.optimise:
        if not keys:
            yield "optimise has nothing to choose: give lists in [vary] or distributions in [sample]"
        if sample and (sample.method or sample.points):
            yield "sample has method or points, but [optimise] chooses the points; leave them out"
        if tables.seeds.until:
            yield "seeds.until does not go with [optimise]: every trial has the same seeds; give count"
        for key, spread in spreads.items():
            if "normal" in spread.kind:
                yield f'sample."{key}" is {spread.kind}; expected uniform, loguniform, integers or choice to optimise'
    elif sample:
        if not sample.method or not sample.points:
            yield "sample.method and sample.points are missing; give both"
        elif sample.method in BALANCED and sample.points & (sample.points - 1):
            below = 1 << (sample.points.bit_length() - 1)
            yield f"sample.points is {sample.points}; Sobol' points are balanced for {below} or {2 * below}"
        if sample.method == SOBOL_INDICES and sample.points and sample.points < LEAST:
            yield f"sample.points is {sample.points}; expected at least {LEAST} for {SOBOL_INDICES}"
        if not spreads:
            yield 'sample has no key; give one, such as "components.printer.variation" = { uniform = [0.0, 0.4] }'
    if tables.keep.maps == "final" and (grid := [key for key in keys if key == "grid" or key.startswith("grid.")]):
        yield f'keep.maps is "final", in one array, but {grid[0]} changes the grid; write "all" or "none"'


def _scenario(
    name: Any, path: Path, axes: Mapping[str, Any], spreads: Mapping[str, Distribution], errors: list[str]
) -> Scenario | None:
    """The scenario as it stands; its errors, and those of the values of the study, are added to `errors`."""
    if not isinstance(name, str):
        return None
    if not name.endswith(".toml"):
        errors.append(f"scenario is {name!r}; expected a scenario file (.toml)")
        return None
    source = path.parent / name
    with classes_from(source.parent):
        scenario = None
        try:
            scenario = Scenario.load(source)
        except ScenarioError as error:
            errors += [f"scenario {name}: {each}" for each in error.errors]
        try:
            text = scenario.text if scenario else read_toml_text(source)
        except (OSError, TomlError):
            return None  # reported by Scenario.load
        keys = {**axes, **{key: spread.extremes() for key, spread in spreads.items()}}
        places = {key: f'{"vary" if key in axes else "sample"}."{key}"' for key in keys}
        errors += errors_of_values(text, str(source), places, keys)
    if scenario:
        on_bench = [each for each, table in scenario.tables.components.items() if table.kind in devices.KINDS]
        errors += [f"scenario {name}: components.{each} is a device; a study prints on models" for each in on_bench]
    return scenario
