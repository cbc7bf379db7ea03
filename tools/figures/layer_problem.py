"""Pictures and tables of the-layer-problem.md: `python tools/figures/layer_problem.py`, also run by `make gallery`."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from math import nan
from pathlib import Path
from typing import TypeAlias

import numpy as np
from benchmarks.instances import INK, nearly_flat, rough
from matplotlib import rc_context
from matplotlib.figure import Figure

from inkloop.component import FloatMap
from inkloop.printing.run import print_part
from inkloop.report.plot import COLOURS, STYLE, WIDTH_IN, save
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M
from inkloop_controller.core import bindings
from inkloop_controller.core.droplet_relaxation import diffuse, relax
from inkloop_controller.model.starts import even_droplets
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.problem.work import DEFAULT_WORK
from inkloop_controller.program.certificate import certify

ROOT = Path(__file__).parents[2]
HERE = ROOT / "docs" / "explanation"
CYLINDER = ROOT / "scenarios" / "cylinder.toml"
SIDE, LAYERS = 30, 3  # of the rounding picture
SEEDS = (1, 2, 3)
ALPHAS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0)
ALPHA = 0.8
HORIZONS = (1, 2, 3, 4, 5)
LEVELS = (2, 4, 8)
LAYERS_MAX = 150  # a cylinder that is not done by then never will be (assumed)
CERTIFICATE_S = 15.0  # for each surface
PAIRS = 200

Setting: TypeAlias = tuple[tuple[str, float], ...]
"""Overrides of the cylinder's scenario."""
Figures: TypeAlias = Mapping[str, float]


def rounding() -> Figure:
    """Three layers on a nearly flat surface: relaxed, rounded plainly, diffused, repaired; the surface after each."""
    problem = nearly_flat(SIDE, LAYERS)
    relaxed = relax(problem, even_droplets(problem)).droplets
    diffused = diffuse(problem, relaxed)
    repaired = bindings.search(problem, diffused, sweeps_max=DEFAULT_WORK.sweeps).plan
    plans: dict[str, FloatMap] = {
        "relaxed": relaxed,
        "rounded plainly": np.round(relaxed),
        "diffused in order": diffused.astype(np.float64),
        "then repaired": repaired.astype(np.float64),
    }
    figure = Figure(figsize=(WIDTH_IN, 7.2), layout="constrained")
    axes = figure.subplots(LAYERS + 1, len(plans), height_ratios=[1] * LAYERS + [1.05])
    for column, (name, plan) in enumerate(plans.items()):
        error = (problem.target - surface_after(problem, plan)) * UM_PER_M
        for layer in range(LAYERS):
            droplets = axes[layer, column].imshow(plan[layer], cmap="gray_r", vmin=0, vmax=1, interpolation="nearest")
            axes[layer, column].set_title(f"{plan[layer].mean():.2f} droplets per cell")
        top = axes[LAYERS, column].imshow(error, cmap="RdBu", vmin=-2, vmax=2, interpolation="nearest")
        axes[LAYERS, column].set_title(f"$\\bf{{J}}$ = {np.abs(error).mean():.2f} µm", fontsize=10)
        axes[0, column].set_title(f"{name}\n{axes[0, column].get_title()}")
    for row, label in enumerate([*(f"layer {layer + 1}" for layer in range(LAYERS)), "surface after them"]):
        axes[row, 0].set_ylabel(label)
    for each in axes.flat:
        each.set(xticks=[], yticks=[])
    figure.colorbar(droplets, ax=axes[:LAYERS], label="droplets on a cell", shrink=0.5)
    figure.colorbar(top, ax=axes[LAYERS], label="target - height [µm]", extend="both")
    return figure


def surface_after(problem: HorizonProblem, plan: FloatMap) -> FloatMap:
    """The surface (nx, ny) after droplets of any size (layers, nx, ny)."""
    height, everywhere = problem.height, np.ones(problem.height.shape, np.int32)
    for layer in plan:
        height = bindings.layer(height, everywhere, problem.kinds, factor=np.ascontiguousarray(layer))
    return height


def alpha_sweep(prints: Mapping[Setting, Sequence[Figures]]) -> Figure:
    """What a part ends as, by the weight of its height against its evenness, one and three layers ahead."""
    figure = Figure(figsize=(WIDTH_IN, 2.5), layout="constrained")
    panels = {"mean_error": "mean error [µm]", "mae": "mean absolute error [µm]", "std": "standard deviation [µm]"}
    for axes, (key, label) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        for horizon, colour in zip((1, 3), COLOURS, strict=False):
            each = np.array([[run[key] * UM_PER_M for run in prints[setting(horizon, alpha)]] for alpha in ALPHAS])
            axes.plot(ALPHAS, each, ".", color=colour, ms=3)
            axes.plot(ALPHAS, each.mean(axis=1), color=colour, label=f"horizon {horizon}")
        axes.set(xlabel=r"$\alpha$", title=label, xscale="log", ylim=None if key == "mean_error" else (0, None))
        axes.set_xticks(ALPHAS, [f"{alpha:g}" for alpha in ALPHAS])
        axes.set_xticks([], minor=True)
        axes.grid(color="0.92")
    first = figure.axes[0]
    first.axhline(0, color="black", linestyle="--", linewidth=1)
    first.set_ylabel("too high      too low")
    first.legend(loc="lower right")
    return figure


def horizon_figure(prints: Mapping[Setting, Sequence[Figures]]) -> Figure:
    """What each layer of the horizon brings, and what it costs."""
    figure = Figure(figsize=(WIDTH_IN, 2.3), layout="constrained")
    panels = {
        "std": ("standard deviation [µm]", 1 / UM_PER_M),
        "layers": ("layers printed", 1.0),
        "solve_time": ("time per plan, of horizon 1", unit_time(prints)),
    }
    for axes, (key, (label, unit)) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        each = np.array([[run[key] / unit for run in prints[setting(horizon, ALPHA)]] for horizon in HORIZONS])
        axes.bar(HORIZONS, each.mean(axis=1), color=COLOURS[0], width=0.6)
        axes.plot(HORIZONS, each, ".", color="black", ms=3)
        axes.set(xlabel="horizon [layers]", title=label, xticks=HORIZONS)
    return figure


def unit_time(prints: Mapping[Setting, Sequence[Figures]]) -> float:
    """Time of a plan with a horizon of one layer [s]; ratios to it depend less on other work of the machine."""
    return float(np.mean([run["solve_time"] for run in prints[setting(1, ALPHA)]]))


def setting(horizon: int, alpha: float) -> Setting:
    """Overrides for a controller that looks so many layers ahead and prints every layer that gains anything."""
    options = {"horizon": horizon, "alpha": alpha, "layer_worth": 0.0}
    return tuple((f"components.controller.{name}", value) for name, value in options.items())


def grey(levels: int) -> Setting:
    """Overrides for a head whose largest droplet is that of the cylinder, in so many steps."""
    drop = ((f"ink.a.{name}_um", float(f"{value / levels * UM_PER_M:.6g}")) for name, value in vars(INK).items())
    return (*setting(3, ALPHA), ("components.controller.drop_levels", levels), *drop)


def printed(setting: Setting, seed: int) -> Figures:
    """Errors of the last surface over the part [m] (NaN: nothing was printed), layers, and time per plan [s]."""
    result = print_part(Scenario.load(CYLINDER, {"seed": seed, "run.layers_max": LAYERS_MAX, **dict(setting)}))
    figures = {name: result.metrics()[name] for name in ("mean_error", "mae", "std", "layers")}
    if figures["layers"] == 0.0:
        return {**dict.fromkeys((*figures, "solve_time"), nan), "layers": 0.0, "finished": 0.0}
    solve_time = float(result.dataset.solve_time[:-1].mean())
    return {**figures, "solve_time": solve_time, "finished": float(result.stop_reason == "done")}


def all_prints(settings: Sequence[Setting]) -> dict[Setting, list[Figures]]:
    """Every setting with every seed."""
    runs = list(product(settings, SEEDS))
    with ProcessPoolExecutor() as pool:
        figures = list(pool.map(printed, *zip(*runs, strict=True)))
    return {
        setting: figures[first : first + len(SEEDS)]
        for setting, first in zip(settings, range(0, len(runs), len(SEEDS)), strict=True)
    }


def print_rows(name: str, prints: Mapping[str, Sequence[Figures]], unit_s: float) -> None:
    """A table of means over the seeds, as the page has it."""
    show(f"\n| {name} | mean error | mae | std | layers | time per plan | finished |")
    show("|---|---|---|---|---|---|---|")
    for label, runs in prints.items():
        mean = {key: float(np.mean([run[key] for run in runs])) for key in runs[0]}
        show(
            f"| {label} | {mean['mean_error'] * UM_PER_M:.2f} | {mean['mae'] * UM_PER_M:.2f} "
            f"| {mean['std'] * UM_PER_M:.2f} | {mean['layers']:.0f} | {mean['solve_time'] / unit_s:.1f} "
            f"| {sum(run['finished'] for run in runs):.0f} of {len(runs)} |"
        )


def print_certificates() -> None:
    """What HiGHS proves of single layers, in a limited time."""
    show("\n| surface | J | bound | gap | confidence | tiles proven | seconds |")
    show("|---|---|---|---|---|---|---|")
    for name, problem in {
        "rough, 20 x 20": rough((20, 20)),
        "nearly flat, 20 x 20": nearly_flat(20, 1),
        "rough, 100 x 100": rough((100, 100)),
        "nearly flat, 100 x 100": nearly_flat(100, 1),
    }.items():
        start = diffuse(problem, relax(problem, even_droplets(problem)).droplets)
        plan = bindings.search(problem, start, sweeps_max=50, annealing_sweeps=200).plan
        found = certify(problem, plan, seconds_max=CERTIFICATE_S)
        show(
            f"| {name} | {found.objective * UM_PER_M:.3f} µm | {found.bound * UM_PER_M:.3f} µm | {found.gap:.1%} "
            f"| {found.confidence:.0%} | {found.tiles_proven} of {found.tiles_solved} | {found.seconds:.1f} |"
        )


def largest_gain() -> float:
    """How much further apart two surfaces are after the same droplets than before, at most (largest cell) [1]."""
    rng, gain = np.random.default_rng(0), 0.0
    for _ in range(PAIRS):
        first = rng.uniform(0.0, 8e-6, (SIDE, SIDE))
        second = first + rng.uniform(-2e-6, 2e-6, first.shape)
        pattern = rng.integers(0, 2, first.shape, np.int32)
        apart = bindings.layer(second, pattern, (INK,)) - bindings.layer(first, pattern, (INK,))
        gain = max(gain, float(np.abs(apart).max() / np.abs(second - first).max()))
    return gain


def runaway(alpha: float) -> float:
    """How far a surface on target climbs in ten layers [m] if plans are not compared with printing nothing."""
    problem = replace(nearly_flat(SIDE, 1), alpha=alpha)
    level, full = problem.height.mean(), np.ones((1, SIDE, SIDE), np.int32)
    problem = replace(problem, target=np.full_like(problem.height, level))
    for _ in range(10):
        plan = bindings.search(problem, full, sweeps_max=DEFAULT_WORK.sweeps).plan
        problem = replace(problem, height=bindings.layer(problem.height, plan[0], (INK,)))
    return float(problem.height.mean() - level)


def show(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    began = time.monotonic()
    sweep = {(horizon, alpha): setting(horizon, alpha) for horizon in (1, 3) for alpha in ALPHAS}
    horizons = {f"horizon {horizon}": setting(horizon, ALPHA) for horizon in HORIZONS}
    heads = {f"{levels} drop sizes": grey(levels) for levels in LEVELS}
    prints = all_prints(list(dict.fromkeys([*sweep.values(), *horizons.values(), *heads.values()])))
    with rc_context(STYLE):
        for name, figure in (
            ("rounding", rounding()),
            ("alpha", alpha_sweep(prints)),
            ("horizon", horizon_figure(prints)),
        ):
            save(figure, HERE / f"{name}.png")
    unit_s = unit_time(prints)
    print_rows("alpha", {f"{h} ahead, {a}": prints[key] for (h, a), key in sweep.items()}, unit_s)
    print_rows("horizon", {name: prints[key] for name, key in horizons.items()}, unit_s)
    print_rows("head", {name: prints[key] for name, key in heads.items()}, unit_s)
    for alpha in ALPHAS:
        show(
            f"\nalpha {alpha}, never compared with printing nothing: {runaway(alpha) * UM_PER_M:+.1f} um in ten layers"
        )
    print_certificates()
    show(f"\nlargest gain of the difference of two surfaces: {largest_gain():.3f}")
    show(f"\nall of it took {time.monotonic() - began:.0f} s")
