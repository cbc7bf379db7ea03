"""Prints of the shipped scenarios that tests look at, each printed once per run of the tests."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from support.once_per_run import once
from support.places import SCENARIOS

LITTLE_WORK = (("components.controller.horizon", 2), ("components.controller.annealing_sweeps", 1))
"""For prints of which the plan is not tested: a part of the cuboid's size is printed in a thirtieth of the time."""
Overrides = tuple[tuple[str, Any], ...]
TWO_AHEAD: Overrides = (("components.controller.horizon", 2),)
THREE_AHEAD: Overrides = (("components.controller.horizon", 3),)
CHEAPER: Mapping[str, Overrides] = {
    "bench": (("part.height_um", 4.0),),
    "blurred-scan": THREE_AHEAD,
    "bracket": LITTLE_WORK,
    "casadi": (("part.height_um", 40.0),),
    "cylinder": THREE_AHEAD,
    "cylinder-40": THREE_AHEAD,
    "dead-nozzles": THREE_AHEAD,
    "drifting-ink": THREE_AHEAD,
    "four-passes": THREE_AHEAD,
    "grey-head": TWO_AHEAD,
    "misaligned-scan": THREE_AHEAD,
    "no-flow": THREE_AHEAD,
    "noisy-sensor": THREE_AHEAD,
    "nozzle-stays-dead": THREE_AHEAD,
    "pipe-junction": (*TWO_AHEAD, ("part.height_um", 60.0)),
    "pipe-junction-3mf": (("components.controller.horizon", 1), ("part.scale", 0.25)),
    "staircase": THREE_AHEAD,
    "surface-tension": (("part.height_um", 30.0),),
    "tilted-substrate": THREE_AHEAD,
    "two-ink-3mf": TWO_AHEAD,
    "two-materials": THREE_AHEAD,
    "uneven-start": THREE_AHEAD,
    "wide-droplets": THREE_AHEAD,
}
"""Scenario -> overrides with which a print of 3 to 20 s shows the same in one or two."""
QUICK_CUBOID: Overrides = (*LITTLE_WORK, ("part.height_um", 40.0))
"""Changes by `quick_cuboid`."""


def scenario(name: str, overrides: Overrides = ()) -> Scenario:
    """One of those that are shipped."""
    return Scenario.load(SCENARIOS / f"{name}.toml", dict(overrides))


def printed(name: str, *overrides: tuple[str, Any], variant: str = "") -> Result:
    """A print of a scenario or of a variant in its `compare`, on FMUs and Python classes."""
    return _loaded(once(_print, name, overrides, variant))


def overrides_of(name: str, seed: int) -> Overrides:
    """The seed, and what makes this scenario cheaper."""
    return (("seed", seed), *CHEAPER.get(name, ()))


@cache
def _loaded(folder: Path) -> Result:
    found: Result = pickle.loads((folder / "result").read_bytes())
    return found


def _print(folder: Path, name: str, overrides: Overrides, variant: str) -> None:
    whole = scenario(name, overrides)
    (folder / "result").write_bytes(pickle.dumps(print_part(whole.variant(variant) if variant else whole)))


def quick_cuboid() -> Path:
    """cuboid.toml with less work to plan it and twice as high, for tests that look at what becomes of any print."""
    return once(_write_quick_cuboid) / "cuboid.toml"


def _write_quick_cuboid(folder: Path) -> None:
    text = scenario("cuboid", QUICK_CUBOID).text
    (folder / "cuboid.toml").write_text(text, encoding="utf-8")
