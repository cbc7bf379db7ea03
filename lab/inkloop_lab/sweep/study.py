"""A study: the file as tables, the scenario that it changes, and the points to print."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from inkloop.components import devices
from inkloop.errors import ScenarioError
from inkloop.files import TomlError, read_toml_text, toml_tables
from inkloop.results.made_folder import made_folder
from inkloop.scenario.file import Scenario
from inkloop.scenario.packaged import classes_from
from inkloop.tables.messages import sentence
from inkloop_lab.sweep.sampling import (
    BALANCED,
    LEAST,
    SOBOL_INDICES,
    Distribution,
    Samples,
    sampled,
)
from inkloop_lab.sweep.tables import StudyFile, axes_of, distributions_of

TRIES = 50
"""Points that a value is tried with that does not fit the scenario as it stands."""
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
            reason = made_folder(path) or f"cannot be read: {error.strerror}; expected a study file"
            raise ScenarioError(str(path), [reason]) from error
        except TomlError as error:
            raise ScenarioError(str(path), [str(error)]) from error
        if "components" in raw:
            table = 'title = "..." and scenario = "..."'
            raise ScenarioError(str(path), [f"is a scenario; name it in a study file, which has {table}"])
        errors: list[str] = []
        axes = dict(axes_of(raw.get("vary", {}), errors))
        spreads = dict(distributions_of(raw, errors))
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
        return math.prod(self.shape.values())

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
    suffix = Path(name).suffix
    if suffix not in ("", ".toml"):
        errors.append(f"scenario is {name!r}; expected a scenario file (.toml), or a name of inkloop's")
        return None
    source = path.parent / name if suffix else Path(name)
    with classes_from(source.parent):
        scenario = None
        try:
            scenario = Scenario.load(source)
        except ScenarioError as error:
            errors += [f"scenario {name}: {each}" for each in error.errors]
        try:
            source, text = (Path(scenario.source), scenario.text) if scenario else (source, read_toml_text(source))
        except (OSError, TomlError):
            return None  # reported by Scenario.load
        keys = {**axes, **{key: spread.extremes() for key, spread in spreads.items()}}
        places = {key: f'{"vary" if key in axes else "sample"}."{key}"' for key in keys}
        errors += _errors_of_values(text, str(source), places, keys)
    if scenario:
        on_bench = [each for each, table in scenario.tables.components.items() if table.kind in devices.KINDS]
        errors += [f"scenario {name}: components.{each} is a device; a study prints on models" for each in on_bench]
    return scenario


def _errors_of_values(
    text: str, source: str, places: Mapping[str, str], keys: Mapping[str, Sequence[Any]]
) -> list[str]:
    """A sentence for each value that fits neither the scenario nor the scenario with another key of the study changed.

    places: key -> where it stands in the study; keys: key -> its values. A value that fits with some other keys only is
    no error of the study: the points that it does not fit become rows with their error.
    """
    known = set(_errors(text, source, {}))
    found = []
    for key, values in keys.items():
        for value in values:
            errors = [error for error in _errors(text, source, {key: value}) if error not in known]
            if not errors or (not known and _fits_with_others(text, source, key, value, keys)):
                continue
            found += [f"{places[key]}: {error}" for error in errors]
    return list(dict.fromkeys(found))


def _fits_with_others(text: str, source: str, key: str, value: Any, keys: Mapping[str, Sequence[Any]]) -> bool:
    others = ({other: each} for other, values in keys.items() if other != key for each in values)
    return any(not _errors(text, source, {**other, key: value}) for other, _ in zip(others, range(TRIES), strict=False))


def _errors(text: str, source: str, overrides: Mapping[str, Any]) -> tuple[str, ...]:
    try:
        Scenario.of_text(text, source, overrides)
    except ScenarioError as error:
        return error.errors
    return ()
