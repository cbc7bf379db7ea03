"""What the-layer-problem.md says of single plans: rounding, alpha, one layer, certificates."""

from __future__ import annotations

from dataclasses import replace
from inspect import signature
from math import sqrt
from typing import Any, get_args

import numpy as np
from benchmarks.instances import INK, nearly_flat, rough
from matplotlib import rc_context
from matplotlib.figure import Figure
from tools.figures.pages import DOCS, Texts, read_json, table, write_json

from inkloop.component import FloatMap
from inkloop.report.plot import STYLE, WIDTH_IN, save
from inkloop.results.metrics import SIGN
from inkloop.units import UM_PER_M
from inkloop_controller import LayerMpc
from inkloop_controller.core import bindings
from inkloop_controller.core.bindings import diffuse
from inkloop_controller.model.starts import even_droplets
from inkloop_controller.planning.horizon_planner import Finish, ending_of
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.problem.work import DEFAULT_WORK
from inkloop_controller.program.certificate import certify
from support.core_search import relax, search

HERE = DOCS / "explanation"
RECORD = HERE / "layer-problem.json"
SIDE, LAYERS = 30, 3  # of the rounding picture
ALPHAS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0)
RUNAWAY_LAYERS = 10
CERTIFICATE_S = 15.0  # for each surface
PAIRS = 200


def run() -> None:
    """Solve everything; some of it takes as long as HiGHS is given."""
    with rc_context(STYLE):
        save(rounding(), HERE / "rounding.png")
    record = {
        "runaway_um": {f"{alpha:g}": round(runaway(alpha) * UM_PER_M, 3) for alpha in ALPHAS},
        "largest_gain": round(largest_gain(), 6),
        "certificates": certificates(),
    }
    write_json(RECORD, record)


def texts() -> Texts:
    """Tables, and figures that follow from the ink."""
    record = read_json(RECORD)
    climbs = {alpha: f"{climb:.1f}" for alpha, climb in record["runaway_um"].items()}
    return {
        HERE / "the-layer-problem.md": {
            "runaway": table(("alpha", *climbs), [("µm", *climbs.values())]),
            "gain": f"{record['largest_gain']:.3f}",
            "certificates": certificate_table(record["certificates"]),
            **of_the_ink(),
        }
    }


def of_the_ink() -> dict[str, str]:
    """What follows from h1, h2, h3 alone [um]."""
    h1, h2, h3 = (value * UM_PER_M for value in (INK.h1, INK.h2, INK.h3))
    rim = h1 + 2 * h2 + 4 * h3  # three sides and two corners lie outside the part
    layers = (int(np.ceil(400.0 / (rim * (1 - p / 2)))) for p in (0.2, 0.4))
    floor = (p * h1 / sqrt(12.0) for p in (0.2, 0.4))
    full = h1 + 4 * h2 + 4 * h3
    default = signature(LayerMpc).parameters["finish"].default
    worth = []
    for name in get_args(Finish):
        each, label = ending_of(name), f'`"{name}"`' + (" (default)" if name == default else "")
        worth.append((label, f"{each.horizon}", f"{each.layer_worth:g}", f"{each.layer_worth * full:.3f} µm"))
    return {
        "last droplet": "{:.2f} µm at 20 % and {:.2f} µm at 40 %".format(*floor),
        "floor": "{:.2f} and {:.2f} µm at 20 %, {:.2f} and {:.2f} µm at 40 %".format(
            *last_layer(0.2), *last_layer(0.4)
        ),
        "rim": f"{rim:.1f} µm",
        "fewest layers": "{} layers at 20 % and {} at 40 %".format(*layers),
        "slope": f"{4 * h2 / (h1 + h2) + 4 * h3 / (h1 + h3):.2f}",
        "pit": f"{h1 + 8 * h2 + 8 * h3:.1f} µm",
        "worth": table(("`finish`", "horizon", "worth of a layer", f"of {full:.1f} µm"), worth),
    }


def last_layer(variation: float) -> tuple[float, float]:
    """Mean absolute error and standard deviation [um] that one full layer on level ground leaves, its mean removed."""
    volume = np.random.default_rng(1).uniform(1.0 - variation, 1.0, (500, 500))
    sides = sum(np.roll(volume, step, axis) for axis in (0, 1) for step in (-1, 1))
    corners = sum(np.roll(volume, (i, j), (0, 1)) for i in (-1, 1) for j in (-1, 1))
    height = (INK.h1 * volume + INK.h2 * sides + INK.h3 * corners) * UM_PER_M
    rest = height - height.mean()
    return float(np.abs(rest).mean()), float(rest.std())


def rounding() -> Figure:
    """Three layers on a nearly flat surface: relaxed, rounded plainly, diffused, repaired; the surface after each."""
    problem = nearly_flat(SIDE, LAYERS)
    relaxed = relax(problem, even_droplets(problem)).droplets
    diffused = diffuse(problem, relaxed)
    repaired = search(problem, diffused, sweeps_max=DEFAULT_WORK.sweeps).plan
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
    figure.colorbar(top, ax=axes[LAYERS], label=f"error [µm] ({SIGN})", extend="both")
    return figure


def surface_after(problem: HorizonProblem, plan: FloatMap) -> FloatMap:
    """The surface (nx, ny) after droplets of any size (layers, nx, ny)."""
    height, everywhere = problem.height, np.ones(problem.height.shape, np.int32)
    for layer in plan:
        height = bindings.layer(height, everywhere, problem.kinds, factor=np.ascontiguousarray(layer))
    return height


def certificates() -> list[dict[str, Any]]:
    """What HiGHS proves of single layers, in a limited time."""
    found = []
    for name, problem in {
        "rough, 20 x 20": rough((20, 20)),
        "nearly flat, 20 x 20": nearly_flat(20, 1),
        "rough, 100 x 100": rough((100, 100)),
        "nearly flat, 100 x 100": nearly_flat(100, 1),
    }.items():
        start = diffuse(problem, relax(problem, even_droplets(problem)).droplets)
        plan = search(problem, start, sweeps_max=50, annealing_sweeps=200).plan
        proof = certify(problem, plan, seconds_max=CERTIFICATE_S)
        found.append(
            {
                "surface": name,
                "objective_um": round(proof.objective * UM_PER_M, 4),
                "bound_um": round(proof.bound * UM_PER_M, 4),
                "gap": round(proof.gap, 4),
                "confidence": proof.confidence,
                "tiles_proven": proof.tiles_proven,
                "tiles_solved": proof.tiles_solved,
            }
        )
    return found


def certificate_table(found: list[dict[str, Any]]) -> str:
    """One row for each surface."""
    heads = ("surface", "J [µm]", "bound", "gap", "confidence", "tiles proven")
    rows = [
        (
            each["surface"],
            f"{each['objective_um']:.3f}",
            f"{each['bound_um']:.3f}",
            f"{each['gap'] * 100.0:.1f} %",
            "proven" if each["confidence"] == 1.0 else f"{each['confidence'] * 100.0:.0f} %",
            f"{each['tiles_proven']} of {each['tiles_solved']}",
        )
        for each in found
    ]
    return table(heads, rows)


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
    """How far a surface on target climbs [m] if plans are never compared with printing nothing."""
    problem = replace(nearly_flat(SIDE, 1), alpha=alpha)
    level, full = problem.height.mean(), np.ones((1, SIDE, SIDE), np.int32)
    problem = replace(problem, target=np.full_like(problem.height, level))
    for _ in range(RUNAWAY_LAYERS):
        plan = search(problem, full, sweeps_max=DEFAULT_WORK.sweeps).plan
        problem = replace(problem, height=bindings.layer(problem.height, plan[0], (INK,)))
    return float(problem.height.mean() - level)
