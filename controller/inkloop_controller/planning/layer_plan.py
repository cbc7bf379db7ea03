"""Interface of planners: the request and the plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntFlag, StrEnum
from functools import cached_property
from math import inf, isfinite, nan
from typing import TYPE_CHECKING, Protocol

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import require
from inkloop.units import UM_PER_M
from inkloop_controller.core.bindings import split
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.problem.horizon_problem import IntMap, IntPlan, Objective

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PlanStatus(StrEnum):
    """Origin of a plan."""

    OPTIMAL = "optimal"  # its objective is the bound: nothing can be better
    REPAIRED = "repaired"  # no single change improves it
    BUDGET = "budget"  # the work budget ended the repair
    TIME_LIMIT = "time limit"  # the clock ended the repair
    INTERRUPTED = "interrupted"  # Ctrl-C ended the repair
    FALLBACK = "fallback"  # the repair could not run: the best of the starts
    FIXED = "fixed"  # settled without an objective, before the print or by a rule
    DONE = "done"  # printing nothing is best: the print is finished


class LeftOut(IntFlag):
    """Stages that a time limit has left out of a plan, or cut short."""

    NOTHING = 0
    RELAXATION = 1
    STARTS = 2
    REPAIR = 4
    FEWER_LAYERS = 8
    CERTIFICATE = 16


PANEL_IN = 2.2  # side of the picture of one layer, in inches
PROVEN = 1e-6  # of a layer's height: an objective this near its bound differs by the rounding of the solvers


def gap_of(objective: float, bound: float) -> float:
    """Gap of an objective to the best one at most, as a share of it; NaN without a bound."""
    if not isfinite(bound):
        return nan
    excess = max(0.0, objective - bound)
    return excess / objective if objective > 0.0 else (0.0 if excess == 0.0 else inf)


@dataclass(frozen=True, eq=False)
class LayerPlan:
    """The plan for the coming layers, and how good it is.

    plan: (layers, nx, ny), 0 nothing, 1 + kind of droplet, where kind (drops - 1) * inks + ink is one ink in one size;
    inks: how many there are; objective of the surface after the last layer [m];
    predict: calculates `predicted_height`, which no print needs; start: the candidate that won; bound: no plan can have
    a lower objective [m], NaN: none; bound_confidence: probability that the bound holds, 1 if proven; seconds: time by
    phase; left_out: by a time limit.
    """

    plan: IntPlan
    inks: int
    objective: Objective
    predict: Callable[[], FloatMap]
    status: PlanStatus
    start: str
    sweeps: int = 0
    bound: float = nan
    bound_confidence: float = 1.0
    seconds: Mapping[str, float] = field(default_factory=dict)
    left_out: LeftOut = LeftOut.NOTHING

    @classmethod
    def of_pattern(
        cls, pattern: IntMap, objective: Objective, predicted: FloatMap, status: PlanStatus, start: str, sweeps: int = 0
    ) -> LayerPlan:
        """The plan of one layer that is a pattern of single drops of one or two inks."""
        return cls(pattern[None], 2, objective, lambda: predicted, status, start, sweeps)

    @property
    def pattern(self) -> IntMap:
        """(nx, ny) the first layer: 0 none, 1 material A, 2 material B."""
        return self._first[0]

    @property
    def drop_level(self) -> IntMap:
        """(nx, ny) the drops that each droplet of the first layer is made of; 0 where nothing is jetted."""
        return np.where(self.pattern > 0, self._first[1], 0).astype(np.int32)

    @cached_property
    def _first(self) -> tuple[IntMap, IntMap]:
        return split(self.plan[0], self.inks)

    @cached_property
    def predicted_height(self) -> FloatMap:
        """(nx, ny) the surface after the first layer [m]."""
        return self.predict()

    @property
    def gap(self) -> float:
        """Gap of the objective to the best one at most, as a share of it; NaN without a bound."""
        return gap_of(self.objective.value, self.bound)

    def plot(self) -> Figure:
        """A picture (matplotlib) of the droplets of each planned layer, and the surface expected after the first."""
        title = f"{self.status}, objective {self.objective.value * UM_PER_M:.3g} µm"
        return _picture(self.plan, self.predicted_height, title)

    def _repr_html_(self) -> str:
        """Its figures, for notebooks."""
        rows = {
            "status": str(self.status),
            "layers ahead": str(len(self.plan)),
            "droplets by layer": ", ".join(str(np.count_nonzero(droplets)) for droplets in self.plan),
            "objective after the last layer": f"{self.objective.value * UM_PER_M:.4g} µm",
            "start": self.start,
            "sweeps": str(self.sweeps),
        }
        if self.left_out:
            rows["left out by the time limit"] = ", ".join(str(stage.name).lower() for stage in self.left_out)
        if isfinite(self.bound):
            rows["no plan is below"] = f"{self.bound * UM_PER_M:.4g} µm (gap {self.gap:.2%})"
        cells = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in rows.items())
        return f"<table><caption><b>layer plan</b></caption><tbody>{cells}</tbody></table>"


class Planner(Protocol):
    """Anything that decides on a layer."""

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """The plan for the surface after `layer` layers, `last`: the plan (layers, nx, ny) made for it.

        elapsed: time since the scan [s], which a time limit counts from; nothing else may depend on it.
        All inputs of a plan are arguments, so that a resumed print continues bit by bit.
        """


def surface_objective(height: FloatMap, target: FloatMap, part: BoolMap, alpha: float) -> Objective:
    """alpha * mean |target - height| + (1 - alpha) * std(height) over the part [m] (Lu et al. 2015, eq. 8)."""
    error, deviation = float(np.abs(target - height)[part].mean()), float(height[part].std())
    return Objective(alpha * error + (1.0 - alpha) * deviation, error, 0.0, deviation)


def _picture(plan: IntPlan, predicted: FloatMap, title: str) -> Figure:
    """The droplets of each planned layer (layers, nx, ny), and the surface [m] that is expected of the first one.

    Each kind of droplet has a colour.
    """
    require("matplotlib", "the picture of a plan")
    from matplotlib.figure import Figure

    layers, shape = len(plan), predicted.shape
    size = PANEL_IN * (layers + 1) + 1.0, PANEL_IN * shape[1] / shape[0] + 0.6
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(1, layers + 1, squeeze=False)[0]
    kinds = max(1, int(plan.max()))
    for number, (axes, droplets) in enumerate(zip(panels, plan, strict=False), 1):
        axes.imshow(np.ma.masked_equal(droplets, 0).T, origin="lower", cmap="Blues", vmin=0, vmax=kinds)
        axes.set_title(f"layer {number}: {np.count_nonzero(droplets)} droplets", fontsize=8)
    surface = panels[layers].imshow(predicted.T * UM_PER_M, origin="lower", cmap="cividis")
    panels[layers].set_title("expected after layer 1", fontsize=8)
    figure.colorbar(surface, ax=panels[layers], label="height [µm]")
    for axes in panels:
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_facecolor("0.95")
    figure.suptitle(title, fontsize=9)
    return figure
