"""Prints of the cylinder with other controllers, horizons, weights, endings and heads: one record for several pages.

The record holds each print; tables show means over the seeds. Only times depend on the machine.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields
from functools import cache
from time import process_time
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from tools.figures.pages import DOCS, ROOT, Texts, read_csv, table, write_csv

from inkloop.component import Ink
from inkloop.printing import print as printing
from inkloop.report.plot import COLOURS, STYLE, WIDTH_IN, save
from inkloop.results.metrics import TOO_HIGH, TOO_LOW
from inkloop.scenario.file import Scenario
from inkloop.units import MS_PER_S, UM_PER_M

HERE = DOCS / "explanation"
RECORD = HERE / "cylinder-prints.csv"
SCENARIOS = {20: "cylinder", 40: "cylinder-40"}
"""Up to this share of a droplet [%] is missing -> scenario."""
TEN, THREE = range(1, 11), range(1, 4)
ALPHAS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0)
HORIZONS = (1, 2, 3, 4, 5)
LEVELS = (2, 4, 8)
LAYERS_MAX = 150  # a cylinder that is not done by then never will be (assumed)
ENDINGS = ("even", "fast", "horizon 3", "horizon 4", "horizon 5", "worth 0.0005", "worth 0.007")


@dataclass(frozen=True)
class Case:
    """Keys of a scenario or one of its comparison runs, and the variations [%] and seeds that it is printed with."""

    keys: Mapping[str, Any]
    seeds: range = TEN
    variations: Sequence[int] = (20,)
    run: str = ""


@dataclass(frozen=True)
class Print:
    """A print: errors over the part [um], layers, processor time for each layer [ms], why it ended."""

    case: str
    variation: int
    seed: int
    mean_error_um: float
    mae_um: float
    std_um: float
    layers: int
    layer_ms: float
    stop_reason: str


def controller(variations: Sequence[int] = (20,), seeds: range = TEN, **options: Any) -> Case:
    """A case with these options of the controller."""
    return Case({f"components.controller.{name}": value for name, value in options.items()}, seeds, variations)


def grey(levels: int) -> Case:
    """A head whose largest droplet is that of the cylinder, in so many steps."""
    drop = {f"ink.a.{name}_um": float(f"{value / levels * UM_PER_M:.6g}") for name, value in vars(Ink()).items()}
    return Case({**controller(horizon=3, layer_worth=0.0, drop_levels=levels).keys, **drop}, THREE)


BOTH = (20, 40)
CASES = {
    "even": controller(BOTH, finish="even"),
    "fast": controller(BOTH, finish="fast"),
    "paper's search": Case({}, TEN, BOTH, "paper's algorithm, same plant"),
    "open loop": Case({}, TEN, BOTH, "open loop"),
    **{f"horizon {each}": controller(BOTH if each > 2 else (20,), horizon=each, layer_worth=0.0) for each in HORIZONS},
    **{f"worth {each}": controller(BOTH, horizon=5, layer_worth=each) for each in (0.0005, 0.007)},
    **{
        f"horizon {horizon}, alpha {alpha}": controller(seeds=THREE, horizon=horizon, layer_worth=0.0, alpha=alpha)
        for horizon in (1, 3)
        for alpha in ALPHAS
    },
    **{f"{levels} drop sizes": grey(levels) for levels in LEVELS},
}
CASES = {name: case for name, case in CASES.items() if not name.endswith(", alpha 0.8")}  # "horizon 1", "horizon 3"


def planned() -> Iterator[tuple[str, int, int]]:
    """Case, variation and seed of every print of the record."""
    for name, case in CASES.items():
        for variation in case.variations:
            for seed in case.seeds:
                yield name, variation, seed


def printed(name: str, variation: int, seed: int) -> Print:
    """One print, also of a case in which nothing is printed."""
    case, file = CASES[name], ROOT / "scenarios" / f"{SCENARIOS[variation]}.toml"
    scenario = Scenario.load(file, {"seed": seed, "run.layers_max": LAYERS_MAX, **case.keys})
    began = process_time()
    result = printing.Print(scenario.variant(case.run) if case.run else scenario).run()
    seconds = process_time() - began
    metrics = result.metrics()
    mean_error, mae, std = (float(metrics[key]) * UM_PER_M for key in ("mean_error", "mae", "std"))
    layers = int(metrics["layers"])
    layer_ms = seconds * MS_PER_S / max(layers, 1)
    return Print(name, variation, seed, mean_error, mae, std, layers, layer_ms, result.stop_reason)


def warm_up() -> None:
    """One print before the measured ones: the first in a process also loads what a print needs."""
    printed("open loop", 20, 1)


def run() -> None:
    """All prints, two or more at a time; stderr tells how far they are."""
    everything = list(planned())
    prints = []
    with ProcessPoolExecutor(initializer=warm_up) as pool:
        for number, found in enumerate(pool.map(printed, *zip(*everything, strict=True)), start=1):
            prints.append(found)
            print(f"print {number} of {len(everything)}: {found}", file=sys.stderr, flush=True)
    write_csv(RECORD, [vars(each) for each in prints])
    with rc_context(STYLE):
        for name, figure in (("finish", trade_off()), ("alpha", alpha_sweep()), ("horizon", horizons())):
            save(figure, HERE / f"{name}.png")


@cache
def record() -> list[Print]:
    """The prints of the last run."""
    types = {field.name: {"int": int, "float": float}.get(str(field.type), str) for field in fields(Print)}
    return [Print(**{key: types[key](cell) for key, cell in row.items()}) for row in read_csv(RECORD)]


def prints_of(name: str, variation: int = 20, seeds: range = TEN) -> list[Print]:
    """The prints of a case, by seed; "horizon 1, alpha 0.8" is "horizon 1"."""
    case = name.removesuffix(", alpha 0.8")
    return [each for each in record() if (each.case, each.variation) == (case, variation) and each.seed in seeds]


def mean(figure: str, name: str, variation: int = 20, seeds: range = TEN) -> float:
    """Mean of a figure over the prints of a case."""
    return float(np.mean([getattr(each, figure) for each in prints_of(name, variation, seeds)]))


def layer_time(name: str) -> float:
    """Processor time of a layer as a multiple of that with one layer ahead, which depends less on the machine."""
    return mean("layer_ms", name) / mean("layer_ms", "horizon 1")


def row(label: str, name: str, figures: Sequence[str], variation: int = 20, seeds: range = TEN) -> list[str]:
    """Errors with two decimals, layers with none."""
    cells = {figure: mean(figure, name, variation, seeds) for figure in figures}
    return [label, *(f"{cell:.0f}" if figure == "layers" else f"{cell:z.2f}" for figure, cell in cells.items())]


ERRORS = ("mean_error_um", "mae_um", "std_um")


def texts() -> Texts:
    """Tables and figures of four pages."""
    return {
        ROOT / "README.md": {"cylinder": result_table(), **one_layer_ahead()},
        HERE / "the-layer-problem.md": {
            "horizons": horizon_table(),
            "endings": ending_table(),
            "grey heads": grey_table(),
            **alpha_figures(),
        },
        HERE / "closing-the-loop.md": {
            "open loop low": f"{mean('mean_error_um', 'open loop'):.0f}",
            "open loop std": f"{mean('std_um', 'open loop'):.1f} and {mean('std_um', 'open loop', 40):.1f}",
        },
    }


def result_table() -> str:
    """The one result of the README."""
    layers = mean("layers", "open loop")
    cases = {
        "inkloop, five layers ahead": "even",
        "the paper's stochastic greedy search": "paper's search",
        f"open loop, {layers:.0f} full layers": "open loop",
    }
    heads = ("same plant, same droplets", "mean error", "mean absolute error", "standard deviation")
    return table(heads, (row(label, name, ERRORS) for label, name in cases.items()))


def one_layer_ahead() -> dict[str, str]:
    """What the horizon is worth."""
    return {
        "one layer ahead": f"{mean('mae_um', 'horizon 1'):.2f} µm and a standard deviation of "
        f"{mean('std_um', 'horizon 1'):.2f} µm"
    }


def horizon_table() -> str:
    """Each layer of the horizon, and what it costs."""
    heads = ("horizon", "mean error", "mae", "std", "layers", "time per layer")
    names = {str(each): f"horizon {each}" for each in HORIZONS}
    figures = (*ERRORS, "layers")
    return table(heads, ([*row(label, name, figures), f"{layer_time(name):.1f}"] for label, name in names.items()))


def ending_table() -> str:
    """Each ending at both variations."""
    heads = ("ending", "20 %: mae", "std", "layers", "40 %: mae", "std", "layers")
    labels = {name: f'`finish = "{name}"`' for name in ("even", "fast")}
    labels |= {f"horizon {each}": f"horizon {each}, every layer" for each in HORIZONS}
    labels |= {name: f"horizon 5, {name}" for name in ENDINGS if name.startswith("worth")}
    figures = ("mae_um", "std_um", "layers")
    return table(heads, ([*row(labels[n], n, figures), *row("", n, figures, 40)[1:]] for n in ENDINGS))


def grey_table() -> str:
    """Heads with one to eight sizes of drops."""
    names = {"1": "horizon 3", **{str(levels): f"{levels} drop sizes" for levels in LEVELS}}
    heads = ("drop sizes", "mean error", "mae", "std", "layers")
    return table(heads, (row(label, name, (*ERRORS, "layers"), seeds=THREE) for label, name in names.items()))


def alpha_figures() -> dict[str, str]:
    """Figures of the text on alpha; a part that is too high has a negative mean error."""
    low, usual = (mean("std_um", f"horizon 1, alpha {alpha}", seeds=THREE) for alpha in (0.1, 0.8))
    high = -mean("mean_error_um", "horizon 1, alpha 0.1", seeds=THREE)
    wild = prints_of("horizon 3, alpha 0.05")
    highest = max((-each.mean_error_um for each in wild), key=abs)
    more = mean("layers", "horizon 3, alpha 0.05") / mean("layers", "horizon 3", seeds=THREE) - 1.0
    return {
        "evenness at alpha 0.1": f"{low:.2f} instead of {usual:.2f} µm",
        "too high at alpha 0.1": f"{high:.1f} µm",
        "alpha 0.05": f"{abs(highest):.1f} µm too {'high' if highest > 0.0 else 'low'}, "
        f"after {more * 100.0:.0f} % more layers",
    }


def trade_off() -> Figure:
    """Layers against standard deviation, each ending one point."""
    figure = Figure(figsize=(WIDTH_IN, 2.8), layout="constrained")
    for axes, variation in zip(figure.subplots(1, len(SCENARIOS)), SCENARIOS, strict=True):
        for number, ending in enumerate(ENDINGS):
            place = mean("layers", ending, variation), mean("std_um", ending, variation)
            label = {"even": 'finish = "even"', "fast": 'finish = "fast"'}.get(ending)
            label = label or (f"{ending}, every layer" if "horizon" in ending else f"horizon 5, {ending}")
            shown = label if variation == next(iter(SCENARIOS)) else None
            axes.plot(*place, "os^vDPX"[number], color=COLOURS[number % len(COLOURS)], label=shown)
        axes.set(xlabel="layers printed", ylabel="standard deviation [µm]", title=f"{variation} % of a droplet missing")
        axes.grid(color="0.92")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def alpha_sweep() -> Figure:
    """What a part ends as, by the weight of its height against its evenness, one and three layers ahead."""
    figure = Figure(figsize=(WIDTH_IN, 2.5), layout="constrained")
    panels = dict(zip(ERRORS, ("mean error [µm]", "mean absolute error [µm]", "standard deviation [µm]"), strict=True))
    for axes, (key, label) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        for horizon, colour in zip((1, 3), COLOURS, strict=False):
            cases = [prints_of(f"horizon {horizon}, alpha {alpha}", seeds=THREE) for alpha in ALPHAS]
            each = np.array([[getattr(one, key) if one.layers else np.nan for one in case] for case in cases])
            axes.plot(ALPHAS, each, ".", color=colour, ms=3)
            axes.plot(ALPHAS, each.mean(axis=1), color=colour, label=f"horizon {horizon}")
        axes.set(xlabel=r"$\alpha$", title=label, xscale="log", ylim=None if key == "mean_error_um" else (0, None))
        axes.set_xticks(ALPHAS, [f"{alpha:g}" for alpha in ALPHAS])
        axes.set_xticks([], minor=True)
        axes.grid(color="0.92")
    first = figure.axes[0]
    first.axhline(0, color="black", linestyle="--", linewidth=1)
    first.set_ylabel(f"{TOO_HIGH} -      {TOO_LOW} +")
    first.legend(loc="lower right")
    return figure


def horizons() -> Figure:
    """What each layer of the horizon brings, and what it costs."""
    figure = Figure(figsize=(WIDTH_IN, 2.3), layout="constrained")
    panels = {
        "std_um": ("standard deviation [µm]", 1.0),
        "layers": ("layers printed", 1.0),
        "layer_ms": ("time per layer, of horizon 1", mean("layer_ms", "horizon 1")),
    }
    for axes, (key, (label, unit)) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        cases = [prints_of(f"horizon {horizon}") for horizon in HORIZONS]
        each = np.array([[getattr(one, key) / unit for one in case] for case in cases])
        axes.bar(HORIZONS, each.mean(axis=1), color=COLOURS[0], width=0.6)
        axes.plot(HORIZONS, each, ".", color="black", ms=3)
        axes.set(xlabel="horizon [layers]", title=label, xticks=HORIZONS)
    return figure
