"""Controllers on the plants of the board: prints with fixed seeds, the scores that compare them, and the inks that they
know: the volume of a droplet only, one droplet, or the best fit to many layers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Ink
from inkloop.contract import HEIGHT, LAYER_COMMAND, PATTERN
from inkloop.errors import InkloopError, nearest
from inkloop.printing.run import print_part
from inkloop.results.metrics import without_sign
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.units import NS_PER_S, UM_PER_M
from inkloop_lab.identify.ink_regression import identify_ink
from inkloop_lab.identify.print_record import PrintRecord
from inkloop_lab.score import PLANTS, VERSIONS

SEEDS = (1, 2, 3)
FOLDER = Path(__file__).parent
METRICS = ("mean_error", "mae", "rms", "std", "highest", "layers", "droplets")
HIGH_UM = 5.0
"""Least height of a cell above the target beyond the unevenness of single droplets (assumed)."""


STEP_NS = NS_PER_S
LAYERS, COVERAGE = 8, 0.7
"""Layers printed to identify an ink, and the share of the part's cells that get a droplet in each (assumed)."""
Pattern = NDArray[np.int32]


def surfaces(scenario: Scenario, patterns: Sequence[Pattern]) -> Iterator[FloatMap]:
    """Surfaces of patterns printed by the printer of a scenario, without controller and sensor: the start, then each
    layer [m].

    Raises ScenarioError, ComponentError.
    """
    components = scenario.build()
    printer = components["printer"]
    inputs = {port.name: port.start_value() for port in printer.inputs}
    try:
        yield np.array(printer.initialize(0, inputs)[HEIGHT])
        for number, pattern in enumerate(patterns):
            inputs |= {PATTERN: pattern, LAYER_COMMAND: np.asarray(number + 1, dtype=np.int32)}
            yield np.array(printer.do_step(number * STEP_NS, STEP_NS, inputs)[HEIGHT])
    finally:
        for component in components.values():
            component.terminate()


def single_droplet(scenario: Scenario) -> Ink:
    """Mean heights that one droplet on flat ground adds to its own cell, and to its side and corner neighbours.

    A model without flow, which adds droplets up, knows nothing else of a plant.
    """
    grid = scenario.tables.grid
    i, j = grid.nx // 2, grid.ny // 2
    pattern = np.zeros((grid.nx, grid.ny), dtype=np.int32)
    pattern[i, j] = 1
    before, after = surfaces(scenario, [pattern])
    left = (after - before)[i - 1 : i + 2, j - 1 : j + 2]
    sides, corners = left[[0, 1, 1, 2], [1, 0, 2, 1]].mean(), left[[0, 0, 2, 2], [0, 2, 0, 2]].mean()
    return Ink(float(left[1, 1]), float(sides), float(corners))


def layers_of(scenario: Scenario, seed: int = 1) -> PrintRecord:
    """Layers printed on top of each other, each with droplets on a random part of the part's cells, measured exactly.

    Raises ScenarioError, ComponentError.
    """
    job, rng = scenario.job(), np.random.default_rng(seed)
    patterns = [(job.mask & (rng.random(job.mask.shape) < COVERAGE)).astype(np.int32) for _ in range(LAYERS)]
    measured = np.stack(list(surfaces(scenario, patterns)))
    order = {name: getattr(job, name) for name in ("passes", "pass_order", "pass_rotation")}
    return PrintRecord(scenario.tables.title, job.pitch, np.stack(patterns), measured, **order)


def identified(scenario: Scenario, seed: int = 1) -> Ink:
    """The ink with which the layer-to-layer model predicts `layers_of` a plant best, by least squares over the grid."""
    return Ink(*(float(h) for h in identify_ink([layers_of(scenario, seed)], 0.0, correct=False).heights[0]))


@dataclass(frozen=True)
class Entry:
    """A controller of the board.

    kind: as in a scenario; options: those of its table; ink: the ink it is configured with, None: the droplets' volume
    in the proportions of Lu et al., Table I; note: text, its knowledge.
    """

    name: str
    kind: str
    options: Mapping[str, Any] = field(default_factory=dict)
    ink: Callable[[Scenario], Ink] | None = None
    note: str = ""


OPEN_LOOP = Entry("open loop", "OpenLoop", note="full layers, blindly")
PAPERS = Entry("paper's search", "StochasticGreedy", note="stochastic greedy search (Lu et al. 2015), Lu nominal")
OURS = Entry("LayerMpc, Lu nominal", "LayerMpc", note="learns the volume of the droplets")
LEARNING = Entry(
    "LayerMpc, Lu identified, learning",
    "LayerMpc",
    {"adapt_ink": "full"},
    identified,
    "the same, learns h1, h2, h3 too",
)
ENTRIES = (
    OPEN_LOOP,
    Entry("superposition", "CohenLipson", {}, single_droplet, "greedy geometric feedback (Cohen, Lipson 2010)"),
    Entry("error diffusion", "ErrorDiffusion", note="of what each layer lacks, Lu nominal"),
    PAPERS,
    OURS,
    Entry("LayerMpc, Lu identified", "LayerMpc", {}, identified, "least squares on random layers of the plant"),
    LEARNING,
    Entry("LayerMpc, single droplet", "LayerMpc", {}, single_droplet, "the ink given to superposition"),
)
AGAINST = (OPEN_LOOP, PAPERS, OURS, LEARNING)
"""Entries compared with a user's controller."""


@dataclass(frozen=True)
class Score:
    """Metrics of an entry on one plant [m], one number for each seed; ink: as configured; highest: above the target."""

    entry: Entry
    plant: str
    ink: Ink
    figures: Mapping[str, Sequence[float]]

    @property
    def version(self) -> str:
        """Of the plants that this one belongs to."""
        return self.plant.partition("/")[0]

    def mean(self, metric: str) -> float:
        """Over the seeds; in micrometres if it is a length."""
        scale = 1.0 if metric in ("layers", "droplets") else UM_PER_M
        return float(np.mean(without_sign(metric, self.figures[metric]))) * scale

    @property
    def highest_um(self) -> float:
        """Of all cells of all seeds, above the target."""
        return max(self.figures["highest"]) * UM_PER_M

    def ends_above(self, open_loop: Score) -> bool:
        """Whether a cell ends higher than every cell of the open loop, and more than `HIGH_UM` above the target."""
        return is_above(self.highest_um, open_loop.highest_um)


def is_above(highest_um: float, open_loop_um: float) -> bool:
    """Whether the highest cell of a print is above that of the open loop, and more than `HIGH_UM` above the target."""
    return highest_um > max(open_loop_um, HIGH_UM)


def named(plant: str) -> str:
    """The whole name of a plant that may be given without its version. Raises InkloopError."""
    found = [each for each in PLANTS if plant in (each, each.partition("/")[2])]
    if not found:
        raise InkloopError(f"there is no plant {plant!r}: {nearest(plant, PLANTS)}")
    return found[0]


def load(plant: str, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario of a plant, with the controller that the overrides give. Raises InkloopError, ScenarioError."""
    return Scenario.load(FOLDER / f"{named(plant)}.toml", overrides)


def overrides_of(entry: Entry) -> dict[str, Any]:
    """Overrides that put a controller into the scenario of a plant."""
    options = {f"components.controller.{name}": value for name, value in entry.options.items()}
    return {"components.controller.kind": entry.kind, **options}


def prints(entry: Entry, plant: str, seeds: Iterable[int]) -> Score:
    """An entry on a plant. Raises ScenarioError, ComponentError; KeyboardInterrupt after Ctrl-C."""
    nominal = load(plant)
    ink = nominal.job().inks[0] if entry.ink is None else entry.ink(nominal)
    figures: dict[str, list[float]] = {metric: [] for metric in METRICS}
    for seed in seeds:
        result = _printed(load(plant, {"seed": seed, **overrides_of(entry), **_overrides(ink)}))
        metrics = result.metrics()
        for metric, values in figures.items():
            values.append(-metrics["min"] if metric == "highest" else metrics[metric])
    return Score(entry, named(plant), ink, figures)


def relative(scores: Sequence[Score], name: str) -> float:
    """Geometric mean, over the plants, of the rms error of an entry over that of the open loop."""
    rms = {(score.entry.name, score.plant): score.mean("rms") for score in scores}
    plants = [plant for of, plant in rms if of == name]
    return float(np.exp(np.mean([np.log(rms[name, plant] / rms[OPEN_LOOP.name, plant]) for plant in plants])))


def fingerprint(version: str) -> str:
    """Begin of the SHA-256 over all plants of a version: the same in every comparison."""
    digest = hashlib.sha256()
    for plant in VERSIONS[version]:
        digest.update((FOLDER / version / f"{plant}.toml").read_bytes())
    return digest.hexdigest()[:12]


def _printed(scenario: Scenario) -> Result:
    result = print_part(scenario)
    if result.stop_reason == "interrupted":
        raise KeyboardInterrupt
    return result


def _overrides(ink: Ink) -> dict[str, float]:
    return {f"ink.a.{name}_um": getattr(ink, name) * UM_PER_M for name in ("h1", "h2", "h3")}
