"""Controllers on the plants of one version: prints with fixed seeds, and the scores that compare them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.component import Ink
from inkloop.errors import InkloopError
from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.studies.score import PLANTS, VERSION
from inkloop.studies.score.known_inks import identified, single_droplet
from inkloop.suggest import nearest
from inkloop.units import UM_PER_M

SEEDS = (1, 2, 3)
FOLDER = Path(__file__).parent / VERSION
METRICS = ("mean_error", "mae", "rms", "std", "layers", "droplets")


@dataclass(frozen=True)
class Entry:
    """A controller of the board.

    kind: as in a scenario; options: those of its table; ink: the ink it is configured with, None: the droplets'
    volume in the proportions of Lu et al., Table I; note: text, what it knows.
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
"""Entries that a user's controller is compared with."""


@dataclass(frozen=True)
class Score:
    """Metrics of an entry on one plant [m], one number for each seed; ink: as configured."""

    entry: Entry
    plant: str
    ink: Ink
    figures: Mapping[str, Sequence[float]]

    def mean(self, metric: str) -> float:
        """Over the seeds; in micrometres if it is a length."""
        scale = 1.0 if metric in ("layers", "droplets") else UM_PER_M
        return float(np.mean(self.figures[metric])) * scale


def load(plant: str, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario of a plant, with the controller that the overrides give. Raises ScenarioError."""
    if plant not in PLANTS:
        raise InkloopError(f"there is no plant {VERSION}/{plant}: {nearest(plant, PLANTS)}")
    return Scenario.load(FOLDER / f"{plant}.toml", overrides)


def overrides_of(entry: Entry) -> dict[str, Any]:
    """What puts a controller into the scenario of a plant."""
    options = {f"components.controller.{name}": value for name, value in entry.options.items()}
    return {"components.controller.kind": entry.kind, **options}


def prints(entry: Entry, plant: str, seeds: Iterable[int]) -> Score:
    """An entry on a plant. Raises ScenarioError, ComponentError; KeyboardInterrupt after Ctrl-C."""
    nominal = load(plant)
    ink = nominal.job().inks[0] if entry.ink is None else entry.ink(nominal)
    figures: dict[str, list[float]] = {metric: [] for metric in METRICS}
    for seed in seeds:
        result = _printed(load(plant, {"seed": seed, **overrides_of(entry), **_overrides(ink)}))
        for metric, value in result.metrics().items():
            if metric in figures:
                figures[metric].append(value)
    return Score(entry, plant, ink, figures)


def relative(scores: Sequence[Score], name: str) -> float:
    """Geometric mean, over the plants, of the rms error of an entry over that of the open loop."""
    rms = {(score.entry.name, score.plant): score.mean("rms") for score in scores}
    plants = [plant for of, plant in rms if of == name and (OPEN_LOOP.name, plant) in rms]
    return float(np.exp(np.mean([np.log(rms[name, plant] / rms[OPEN_LOOP.name, plant]) for plant in plants])))


def fingerprint() -> str:
    """Begin of the SHA-256 over all plants of the version: the same in every comparison."""
    digest = hashlib.sha256()
    for plant in PLANTS:
        digest.update((FOLDER / f"{plant}.toml").read_bytes())
    return digest.hexdigest()[:12]


def _printed(scenario: Scenario) -> Result:
    result = print_part(scenario)
    if result.stop_reason == "interrupted":
        raise KeyboardInterrupt
    return result


def _overrides(ink: Ink) -> dict[str, float]:
    return {f"ink.a.{name}_um": getattr(ink, name) * UM_PER_M for name in ("h1", "h2", "h3")}
