"""Whole prints of scenarios over several seeds, in processes side by side, and their figures against targets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from math import hypot, isnan, nan
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from rich.progress import track
from rich.table import Table

from inkloop.printing.run import print_part
from inkloop.results.metrics import MEAN_ERROR, without_sign
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.units import M_PER_UM, UM_PER_M

SCENARIOS = Path(__file__).parents[1] / "scenarios"
OURS = "LayerMpc"
OPEN_LOOP = "open loop"
"""The comparison run of that name in a scenario, or the scenario itself if it has this label."""
PAPERS, FLIPS = "paper's search", "flip search, five layers ahead, nominal ink"
PLANNERS: Mapping[str, Mapping[str, Any]] = {
    OURS: {"kind": OURS},
    PAPERS: {"kind": "StochasticGreedy"},
    FLIPS: {"kind": "StochasticGreedy", "horizon": 5, "batch": 1},
}
"""Name of a planner -> options of the controller that differ from those of the scenario."""
SHIFTS = ("shift_x", "shift_y")
LAYERS_KNOWN = 10  # scans of printed walls after which the shift must be known

SHOWN = {
    MEAN_ERROR: ("distance of the mean from the target, um", UM_PER_M),
    "mae": ("mean absolute error, um", UM_PER_M),
    "std": ("standard deviation, um", UM_PER_M),
    "rms": ("rms error, um", UM_PER_M),
    "highest": ("highest above target, um", UM_PER_M),
    "layers": ("layers", 1.0),
    "shift_error": (f"estimated shift after {LAYERS_KNOWN} layers, error, cells", 1.0),
    "untrusted": ("layers with status untrusted", 1.0),
}
"""Name and scale of each metric."""


@dataclass(frozen=True)
class Wanted:
    """Target of one metric, as in `Figure`."""

    metric: str
    must: float = nan
    aim: float = nan
    printed: str = "-"
    worst: bool = False


@dataclass(frozen=True)
class Case:
    """A scenario with overrides, printed with several seeds by each planner, and what is wanted of it.

    planners: of PLANNERS, or `OPEN_LOOP`; they print on the same plant with the same droplets.
    """

    name: str
    scenario: Path
    wanted: tuple[Wanted, ...]
    overrides: Mapping[str, Any] = field(default_factory=dict)
    seeds: int = 10
    planners: tuple[str, ...] = (OURS,)


Metrics: TypeAlias = dict[tuple[str, str], list[Mapping[str, float]]]
"""Metrics [m] of the prints of a case by a planner, in the order of their seeds."""


def printed(cases: Iterable[Case], seeds_max: int) -> Metrics:
    """Print all cases, two at a time on two processors."""
    prints = [
        (case, planner, seed)
        for case in cases
        for planner in case.planners
        for seed in range(1, min(case.seeds, seeds_max) + 1)
    ]
    metrics: Metrics = {}
    with ProcessPoolExecutor() as pool:
        done = track(pool.map(one_print, *zip(*prints, strict=True)), "prints", len(prints), transient=True)
        for (case, planner, _), found in zip(prints, done, strict=True):
            metrics.setdefault((case.name, planner), []).append(found)
    return metrics


def figures(case: Case, metrics: Metrics) -> list[Figure]:
    """Figures of all that is wanted of a case."""
    return [_figure(case, wanted, metrics) for wanted in case.wanted]


def column(metrics: Metrics, case: Case, planner: str, metric: str) -> list[float]:
    """One metric of all prints of a case, in the unit of the tables; of mean errors the absolute values."""
    return without_sign(metric, (found[metric] * SHOWN[metric][1] for found in metrics.get((case.name, planner), [])))


def _figure(case: Case, wanted: Wanted, metrics: Metrics) -> Figure:
    ours, open_loop = (column(metrics, case, planner, wanted.metric) for planner in (OURS, OPEN_LOOP))
    return Figure(SHOWN[wanted.metric][0], ours, wanted.must, wanted.aim, open_loop, wanted.printed, wanted.worst)


def one_print(case: Case, planner: str, seed: int) -> dict[str, float]:
    """Metrics of one print [m]."""
    chosen = {f"components.controller.{key}": value for key, value in PLANNERS.get(planner, {}).items()}
    scenario = Scenario.load(case.scenario, {"seed": seed, **case.overrides, **chosen})
    if planner == OPEN_LOOP and scenario.tables.label != OPEN_LOOP:
        scenario = scenario.variant(OPEN_LOOP)
    return _measured(print_part(scenario), scenario)


def _measured(result: Result, scenario: Scenario) -> dict[str, float]:
    """Errors of the last surface; layers in which the loop was not trusted; error of the estimated shift [cells]."""
    metrics, job = result.metrics(), scenario.job()
    return {
        **metrics,
        "highest": -metrics["min"],
        "untrusted": float((result.dataset["untrusted_reasons"] > 0).sum()),
        "shift_error": _shift_error(result, scenario) / job.pitch,
    }


def _shift_error(result: Result, scenario: Scenario) -> float:
    """Distance of the estimated from the constant shift of the sensor [m]; NaN if the print has fewer layers."""
    run, sensor = result.dataset, scenario.options("profiler")
    if "scan_shift_x" not in run or run.sizes["layer"] <= LAYERS_KNOWN + 1:
        return nan
    after = run.isel(layer=LAYERS_KNOWN + 1)  # an estimate is recorded with the layer that is planned from it
    return hypot(*(float(after[f"scan_{name}"]) - sensor.get(f"{name}_um", 0.0) * M_PER_UM for name in SHIFTS))


HEADINGS = ("case", "figure", "ours", "scatter", "open loop", "printed", "must", "aim", "reached")


@dataclass(frozen=True)
class Figure:
    """A figure of a case, measured on one or more seeds; the mean counts, or the largest.

    ours, open_loop: of our controller and of blind printing on the same plant (empty: it does not apply); printed: by
    the paper, on another plant; must, aim: the largest that will do (NaN: nothing is asked); worst: the largest of the
    seeds counts.
    """

    name: str
    ours: Sequence[float]
    must: float = nan
    aim: float = nan
    open_loop: Sequence[float] = ()
    printed: str = "-"
    worst: bool = False

    @property
    def now(self) -> float:
        """The figure of our controller that is compared. Raises ValueError for a mean whose signs cancel."""
        return self._counting(self.ours)

    @property
    def reached(self) -> str:
        """Whether the aim, or what must be, is reached, or by how much it is missed; "-" where nothing is asked."""
        if isnan(self.must) and isnan(self.aim):
            return "-"
        if self.now <= self.aim:
            return "aim"
        if isnan(self.must):
            return "not the aim"
        if self.now <= self.must:
            return "must"
        return f"MISSED: {self.now / self.must:.2f} x" if self.must else "MISSED"

    def row(self) -> tuple[str, ...]:
        """Its cells in the table, after the case."""
        sample = len(self.ours)
        scatter = f"{np.std(self.ours, ddof=1):.2g}" if sample > 1 else "-"
        others = (self._text(self.open_loop), self.printed)
        limits = ("-" if isnan(limit) else f"{limit:.3g}" for limit in (self.must, self.aim))
        return (self.name, self._text(self.ours), scatter, *others, *limits, self.reached)

    def _text(self, values: Sequence[float]) -> str:
        if not len(values):
            return "-"
        counts = self._counting(values)
        return f"{counts:.4g}" if abs(counts) >= 10.0 else f"{counts:.3g}"

    def _counting(self, values: Sequence[float]) -> float:
        if self.worst:
            return float(np.max(values))
        if min(values) < 0.0 < max(values):
            raise ValueError(f"{self.name}: {values} have both signs, which cancel in their mean; take absolute values")
        return float(np.mean(values))


def table(title: str, cases: Mapping[str, Sequence[Figure]]) -> Table:
    """The figures of all cases, without empty columns; "scatter" is the standard deviation over seeds."""
    rows = [
        ("" if number else case, *figure.row())
        for case, figures in cases.items()
        for number, figure in enumerate(figures)
    ]
    used = [index for index in range(len(HEADINGS)) if any(row[index] not in ("", "-") for row in rows)]
    shown = Table(title=title)
    for index in used:
        shown.add_column(HEADINGS[index], justify="left" if index < 2 else "right", no_wrap=index > 1)
    for number, row in enumerate(rows):
        last = number + 1 == len(rows) or rows[number + 1][0] != ""
        shown.add_row(*(row[index] for index in used), end_section=last)
    return shown
