"""The study file as a set of tables: every key with its type, limits, default and meaning; its keys of the scenario."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from inkloop.errors import near, nearest
from inkloop.tables.shapes import Table
from inkloop_lab.sweep.figures import METRICS, Expression
from inkloop_lab.sweep.sampling import KINDS, Distribution, distribution

Metric = Literal["mean_error", "mae", "rms", "std", "min", "max", "layers", "droplets", "mismatch"]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
SEEDS_MAX = 100_000


class SampleTable(Table):
    """`[sample]`: points that fill the space of some keys evenly. Besides these keys: a distribution for each key."""

    method: Literal["sobol", "halton", "latin-hypercube", "random", "sobol-indices"] | None = Field(
        default=None, description='"sobol", "halton", "latin-hypercube", "random", or "sobol-indices" for sensitivities'
    )
    points: int | None = Field(
        default=None,
        ge=1,
        le=1_000_000,
        description="number of points, of Sobol' a power of two; of sobol-indices that of each of its keys + 2 blocks",
    )
    seed: int = Field(default=0, ge=0, le=2**31 - 1, description="of the sequence of points, not of the prints")


class Until(Table):
    """`[seeds] until`: when a point has enough seeds."""

    metric: Metric = Field(description="metric whose mean over the seeds is to be known well enough")
    standard_error_um: Positive | None = Field(default=None, description="largest standard error of a length")
    standard_error: Positive | None = Field(default=None, description="largest standard error of a count or share")

    @model_validator(mode="after")
    def _with_the_unit_of_the_metric(self) -> Until:
        is_length = METRICS[self.metric][0] == "m"
        right, wrong = ("standard_error_um", "standard_error")[:: 1 if is_length else -1]
        if getattr(self, right) is None or getattr(self, wrong) is not None:
            raise ValueError(f"{self.metric} is {'a length' if is_length else 'no length'}: give {right}, not {wrong}")
        return self

    @property
    def goal(self) -> float:
        """Largest standard error, in micrometres where the metric is a length."""
        return float(self.standard_error_um or self.standard_error or 0.0)


class SeedsTable(Table):
    """`[seeds]`: the prints of a point; the same seeds at every point."""

    count: int = Field(default=1, ge=1, le=SEEDS_MAX, description="prints of each point; with `until` the first ones")
    first: int | None = Field(default=None, ge=0, le=2**31 - 1, description="the first one; none: the scenario's")
    until: Until | None = Field(default=None, description="print further seeds until the standard error is this small")
    max: int | None = Field(default=None, ge=1, le=SEEDS_MAX, description="seeds of a point at most, with `until`")

    @model_validator(mode="after")
    def _fit(self) -> SeedsTable:
        if (self.until is None) != (self.max is None):
            raise ValueError("until and max go together: give both, or neither")
        if self.until and self.max and not 2 <= self.count <= self.max:
            raise ValueError(f"count is {self.count}; with until it is from 2, which give a first error, to max")
        return self


class OptimiseTable(Table):
    """`[optimise]`: the setting with the best value, searched by Optuna."""

    minimise: str | None = Field(default=None, description='such as "mae_um + 0.001 * layers"')
    maximise: str | None = Field(default=None, description="the same, to be made as large as possible")
    trials: int = Field(ge=1, le=100_000, description="settings to try")
    at_once: int = Field(default=4, ge=1, le=256, description="trials that are planned from the same earlier ones")
    seed: int = Field(default=0, ge=0, le=2**31 - 1, description="of the search, not of the prints")

    @field_validator("minimise", "maximise")
    @classmethod
    def _is_an_expression(cls, text: str | None) -> str | None:
        if text is not None:
            Expression(text)
        return text

    @model_validator(mode="after")
    def _one_direction(self) -> OptimiseTable:
        if (self.minimise is None) == (self.maximise is None):
            raise ValueError("give one of minimise and maximise")
        return self

    @property
    def expression(self) -> Expression:
        """Objective: what is made small or large."""
        return Expression(self.minimise or self.maximise or "")


class KeepTable(Table):
    """`[keep]`: what stays of a print besides its metrics."""

    maps: Literal["none", "final", "all"] = Field(
        default="none", description="surfaces: none; the last one of each print, in sweep.nc; all, in run folders"
    )
    layers: bool = Field(default=False, description="save each layer while printing, to resume half-finished prints")


class StudyFile(Table):
    """The whole file; `[vary]` and the distributions of `[sample]` are read by the functions below."""

    schema_version: Literal[1] = 1
    title: str | None = Field(default=None, description="what tables and pictures are called")
    scenario: str = Field(description="scenario file (.toml), relative to this file, or a name of inkloop's")
    metric: Metric = Field(default="std", description="metric that tables and pictures show first")
    vary: dict[str, Any] = Field(default={}, description="key of the scenario -> list of its values")
    sample: SampleTable | None = None
    seeds: SeedsTable = SeedsTable()
    optimise: OptimiseTable | None = None
    keep: KeepTable = KeepTable()


def axes_of(vary: Any, errors: list[str]) -> Iterator[tuple[str, list[Any]]]:
    """Key and values of each entry of `[vary]`; its errors are added to `errors`."""
    for key, values in _leaves(vary) if isinstance(vary, Mapping) else ():
        place = f'vary."{key}"'
        if not isinstance(values, list) or not values:
            errors.append(f"{place} is {values!r}; expected a list of values")
        elif len({repr(value) for value in values}) < len(values):
            errors.append(f"{place} is {values!r}; expected each value once")
        else:
            yield key, values


def distributions_of(raw: dict[str, Any], errors: list[str]) -> Iterator[tuple[str, Distribution]]:
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
