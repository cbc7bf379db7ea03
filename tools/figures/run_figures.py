"""Figures of the runs of a scenario, as its comment quotes them: each a function of the runs."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.results.result import Result
from inkloop.units import UM_PER_M

Runs: TypeAlias = Mapping[str, Result]
"""The runs of a scenario by label; the first one is its own."""
Quote: TypeAlias = Callable[[Runs], float]

DEAD, NOZZLES, CLEANED = (5, 12), 16, 30
"""Of dead-nozzles.toml: the dead nozzles, the nozzles in all, the layer before which they are cleaned."""
MEAN_VOLUME = 0.9  # of a droplet that lacks up to a fifth


def of(label: str, metric: str, factor: float = UM_PER_M) -> Quote:
    """A metric of a run; an empty label means the scenario's own."""
    return lambda runs: float(run_of(runs, label).metrics()[metric]) * factor


def low(label: str = "") -> Quote:
    """How far a run ends too low on average [um]."""
    return of(label, "mean_error")


def high(label: str = "") -> Quote:
    """How far a run ends too high on average [um]."""
    return of(label, "mean_error", -UM_PER_M)


def highest(label: str = "") -> Quote:
    """How far the highest cell of a run is above its target [um]."""
    return of(label, "min", -UM_PER_M)


def lowest(label: str = "") -> Quote:
    """How far the lowest cell of a run is below its target [um]."""
    return of(label, "max")


def uneven(label: str = "") -> Quote:
    """Standard deviation of the top of a run [um]."""
    return of(label, "std")


def layers(label: str = "") -> Quote:
    """Layers of a run."""
    return of(label, "layers", 1.0)


def mismatch(label: str = "") -> Quote:
    """Share of the walls that is misplaced or missing [%]."""
    return of(label, "mismatch", 100.0)


def beyond(one: Quote, other: Quote) -> Quote:
    """By how much one figure is more than another."""
    return lambda runs: one(runs) - other(runs)


def ratio(one: Quote, other: Quote) -> Quote:
    """How many times as large one figure is as another."""
    return lambda runs: one(runs) / other(runs)


def percent_more(one: Quote, other: Quote) -> Quote:
    """By how much one figure is more than another [%]."""
    return lambda runs: 100.0 * (one(runs) / other(runs) - 1.0)


def percent_less(one: Quote, other: Quote) -> Quote:
    """By how much one figure is less than another [%]."""
    return lambda runs: 100.0 * (1.0 - one(runs) / other(runs))


def given(*keys: str) -> Quote:
    """A value of the scenario itself."""

    def value(runs: Runs) -> float:
        found: Any = tomllib.loads(run_of(runs, "").scenario_text)
        for key in keys:
            found = found[key]
        return float(found)

    return value


def droplets(label: str = "") -> Quote:
    """Droplets of a run."""
    return of(label, "droplets", 1.0)


def found_after(runs: Runs) -> float:
    """Layers until the first dead nozzle of dead-nozzles.toml is found."""
    run = run_of(runs, "")
    died = tomllib.loads(run.scenario_text)["events"][0]["at_layer"]
    return float(np.argmax(run.dataset.dead_cells.values > 0) - died)


def dead_cells(label: str = "") -> Quote:
    """Cells that the controller takes for dead, the most in a layer."""
    return lambda runs: float(run_of(runs, label).dataset.dead_cells.max())


def spot_error(layer: int) -> Quote:
    """Error of the estimated width of the spot after a layer [%]."""
    width = given("components", "profiler", "spot_radius_um")
    return lambda runs: (
        100.0 * abs(float(run_of(runs, "").dataset.scan_spot_radius[layer]) * UM_PER_M / width(runs) - 1.0)
    )


def full_layers(runs: Runs) -> float:
    """Layers at the beginning in which every cell of the part gets a droplet."""
    part, patterns = mask(run_of(runs, "")), run_of(runs, "").dataset.pattern.values[1:]
    return float(np.argmin([bool(pattern[part].all()) for pattern in patterns]))


def droplets_of(choose: Callable[[list[int]], float]) -> Quote:
    """A figure of the numbers of droplets in each layer of the scenario's own run."""

    def figure(runs: Runs) -> float:
        patterns = run_of(runs, "").dataset.pattern.values[1:]
        return float(choose([int(np.count_nonzero(pattern)) for pattern in patterns]))

    return figure


def groove(label: str, layer: int) -> Quote:
    """How far the lines of the dead nozzles lie below the rest of the part after a layer, mean [um]."""

    def depth(runs: Runs) -> float:
        run = run_of(runs, label)
        is_dead = np.isin(np.arange(run.dataset.sizes["y"]) % NOZZLES, DEAD)[None, :] & mask(run)
        height = run.dataset.height.values[layer]
        return float(height[mask(run) & ~is_dead].mean() - height[is_dead].mean()) * UM_PER_M

    return depth


def lag(first: int, last: int) -> Quote:
    """By how many layers the estimate of the volume is behind the drift of drifting-ink.toml, mean over layers."""

    def behind(runs: Runs) -> float:
        run = run_of(runs, "")
        drift = tomllib.loads(run.scenario_text)["events"][0]
        layer = np.arange(first, last + 1)
        share = run.dataset.volume_scale.values[layer] / MEAN_VOLUME
        return float((layer - drift["at_layer"] - (1.0 - share) / -drift["per_layer"]).mean())

    return behind


def ring(label: str, inner: float, outer: float) -> Callable[[Runs], FloatMap]:
    """Heights of the cells between two radii, counted in cells from the middle of the grid [um]."""

    def cells(runs: Runs) -> FloatMap:
        height = run_of(runs, label).final_height.values
        i, j = np.indices(height.shape)
        radius = np.hypot(i - (height.shape[0] - 1) / 2, j - (height.shape[1] - 1) / 2)
        return np.asarray(height[(radius > inner) & (radius <= outer)] * UM_PER_M)

    return cells


def weave(label: str) -> Quote:
    """Unevenness of the middle of the cylinder, out to half its radius [um]."""
    return lambda runs: float(ring(label, -1.0, 8.0)(runs).std())


def rim(label: str) -> Quote:
    """Mean height of the cylinder's rim, two cells wide [um]."""
    return lambda runs: float(ring(label, 13.0, 15.0)(runs).mean())


def foot(runs: Runs) -> float:
    """How far the row of cells at the foot of a step of the staircase ends too high, the highest of them [um]."""
    run = run_of(runs, "")
    target, part = run.dataset.target_height.values, mask(run)
    over = (run.final_height.values - target) * UM_PER_M
    feet = [i for i in range(len(target) - 1) if part[i].any() and target[i + 1].max() > target[i].max()]
    return max(float(over[i][part[i]].mean()) for i in feet)


def step_low(label: str, which: int) -> Quote:
    """How far a step of the staircase ends too low, counted from the lowest [um]."""

    def error(runs: Runs) -> float:
        run = run_of(runs, label)
        target = run.dataset.target_height.values
        level = np.unique(target[mask(run)].round(9))[which]
        step = np.isclose(target, level, rtol=0.0, atol=1e-9) & mask(run)
        return float((target - run.final_height.values)[step].mean()) * UM_PER_M

    return error


def reach_sum(runs: Runs) -> float:
    """What a droplet of wide-droplets.toml adds to all cells of its neighbourhood [um]."""
    printer = tomllib.loads(run_of(runs, "").scenario_text)["components"]["printer"]
    cells = {"h1": 1, "h2": 4, "h3": 4, "h4": 4, "h5": 8, "h6": 4}
    return float(sum(count * printer[f"{name}_a_um"] for name, count in cells.items()))


def run_of(runs: Runs, label: str) -> Result:
    """A run by its label; the first one for an empty label."""
    return runs[label] if label else next(iter(runs.values()))


def mask(run: Result) -> BoolMap:
    """The cells of the part."""
    return np.asarray(run.dataset.mask.values, np.bool_)
