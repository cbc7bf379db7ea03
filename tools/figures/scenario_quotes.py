"""The figures that comments of scenarios and the first print quote, and the comparison of comments with them.

The record of the gallery keeps the values; a test compares them with the comments as they are rounded there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from tools.figures.pages import ROOT
from tools.figures.run_figures import (
    CLEANED,
    Quote,
    Runs,
    beyond,
    dead_cells,
    droplets,
    droplets_of,
    foot,
    found_after,
    full_layers,
    given,
    groove,
    high,
    highest,
    lag,
    layers,
    low,
    lowest,
    mismatch,
    percent_less,
    percent_more,
    ratio,
    reach_sum,
    rim,
    spot_error,
    step_low,
    uneven,
    weave,
)

NUMBER = re.compile(r"\d+(?:\.\d+)?")
UNITS = "µm|mm|%|times|(?:more |full |partly filled )?(?:layers|droplets)"
WITH_UNIT = re.compile(rf"{NUMBER.pattern}(?= (?:to {NUMBER.pattern} )?(?:{UNITS}))")
"""A number that a comment must have from a run, or from the scenario."""

OPEN, THIN, NO_ROLLER = "open loop", "open loop, roller, 5 µm", "closed loop, no roller"
BELIEVED = "scans taken as they are"
QUOTES: Mapping[str, Mapping[str, tuple[Quote, ...]]] = {
    "bench": {"in steps of 0.1 µm": (given("components", "profiler", "resolution_um"),)},
    "blurred-scan": {
        "to 6 %, ten layers show it to 0.3 %": (spot_error(2), spot_error(10)),
        "0.39 µm uneven": (uneven(),),
        "highest cell 1.6 µm": (highest(),),
        "25 µm above the target": (highest(BELIEVED),),
        "74 cells": (dead_cells(BELIEVED),),
    },
    "casadi": {
        "0.53 and 0.55 µm": (uneven(), uneven("projected gradients")),
        "ends 17 µm low": (low(OPEN),),
    },
    "cuboid": {
        "7 partly filled layers with 36 droplets more": (layers(), beyond(droplets(), droplets(OPEN))),
        "height to 0.09 µm": (low(),),
        "unevenness to 0.38 µm": (uneven(),),
        "instead of 1.26 µm": (uneven(OPEN),),
        "ends 3.5 µm low": (low(OPEN),),
        "paper ended 4.3 µm low": (given("literature", "printed: the same, open loop", "mean_error_um"),),
    },
    "cylinder-40": {"ends 84 µm low": (low(OPEN),), "flat to 0.7 µm": (uneven(),)},
    "cylinder-open-loop": {"ends 45 µm low": (low(),)},
    "cylinder": {
        "ends 45 µm low": (low(OPEN),),
        "flat to 0.4 µm": (uneven(),),
        "leaves 1.4 µm": (uneven("paper's algorithm, same plant"),),
    },
    "dead-nozzles": {
        "grow to 71 µm": (groove("", CLEANED - 1),),
        "after 3 layers": (found_after,),
        "prints 27 layers more": (beyond(layers(), layers(OPEN)),),
        "flat to 0.4 µm": (uneven(),),
        "27 µm of the depth": (groove(OPEN, -1),),
        "ends 59 µm low": (low(OPEN),),
    },
    "drifting-ink": {
        "ends 77 µm low": (low(OPEN),),
        "by 5 layers": (lag(30, 60),),
        "ends 0.8 µm low": (low("closed loop, ink not adapted"),),
        "after 4 more layers": (beyond(layers("closed loop, ink not adapted"), layers()),),
    },
    "four-passes": {
        "weave of 1.7 µm": (weave(OPEN),),
        "leaves 0.7 µm": (weave("open loop, one pass"),),
        "droops 2.0 µm less": (beyond(rim(OPEN), rim("open loop, one pass")),),
        "0.5 µm of unevenness": (uneven(),),
    },
    "grey-head": {
        "flat to 0.2 µm in 20 layers": (uneven(), layers()),
        "takes 38 layers": (layers("drops 1 to 2"),),
        "single drops 73 layers": (layers("single drops"),),
    },
    "misaligned-scan": {
        "0.37 µm uneven": (uneven(),),
        "highest cell 0.9 µm": (highest(),),
        "22 µm above the target, after 5 layers more": (highest(BELIEVED), beyond(layers(BELIEVED), layers())),
    },
    "noisy-sensor": {
        "flat to 0.4 µm": (uneven(),),
        "1.1 µm uneven": (uneven("scans taken as exact"),),
    },
    "pipe-junction": {"Open loop it is 49 %": (mismatch(OPEN),), "mismatch is 3.6 %": (mismatch(),)},
    "roller": {
        "ends 45 µm low": (low("open loop, no roller"),),
        "with 7 % less ink": (percent_less(droplets(NO_ROLLER), droplets()),),
        "with 80 layers of 5 µm": (layers(THIN), given("compare", THIN, "components", "printer", "roller_step_um")),
        "flat to 0.1 µm": (uneven(THIN),),
        "uses 34 % more ink": (percent_more(droplets(THIN), droplets(NO_ROLLER)),),
    },
    "staircase": {
        "up to 2.2 µm too high": (foot,),
        "top step ends 28 µm low": (step_low(OPEN, -1),),
        "first one 6 µm": (step_low(OPEN, 0),),
    },
    "surface-tension": {
        "ends 28 µm uneven": (uneven(OPEN),),
        "up to 89 µm low": (lowest(OPEN),),
        "up to 29 µm high": (highest(OPEN),),
        "missing: 0.1 µm high": (high(),),
        "3.8 µm uneven": (uneven(),),
    },
    "tall-cylinder": {"125 µm after 132 layers": (low(OPEN), layers(OPEN))},
    "tilted-substrate": {
        "ends 18 µm low": (low(OPEN),),
        "level to 0.3 µm": (uneven(),),
        "70 layers instead of 53": (layers(), layers(OPEN)),
        "After 49 full layers": (full_layers,),
    },
    "two-materials": {"is 6 times as large": (ratio(mismatch(OPEN), mismatch()),)},
    "uneven-start": {"For 48 layers": (full_layers,)},
    "wide-droplets": {
        "adds 7.6 µm": (reach_sum,),
        "0.5 µm uneven": (uneven(),),
        "stops 1.0 µm low": (low("ink not adapted"),),
    },
    "wu-chiu-plant": {
        "ends 0.4 µm high": (high(),),
        "1.9 µm uneven": (uneven(),),
        "ends 5.6 µm low": (low(OPEN),),
        "3.5 µm uneven": (uneven(OPEN),),
        "up to 9.7 µm high": (highest(),),
    },
}
"""Scenario -> piece of its comment -> the numbers in it, in their order."""


MARKS: Mapping[str, Mapping[str, Quote]] = {
    "cylinder": {
        "full layers": full_layers,
        "full droplets": droplets_of(max),
        "fewest droplets": droplets_of(lambda each: min(each[:-1])),
        "levelling droplets": droplets_of(lambda each: each[-2]),
        "last droplets": droplets_of(lambda each: each[-1]),
        "layers": layers(),
    }
}
"""Scenario -> marks of first-print.md, whole numbers of its run."""


def marked(name: str, runs: Runs) -> dict[str, int]:
    """The figures of a scenario in first-print.md."""
    return {mark: round(quote(runs)) for mark, quote in MARKS.get(name, {}).items()}


def quoted(name: str, runs: Runs) -> dict[str, list[float]]:
    """The values that the comment of a scenario quotes, with four significant digits."""
    return {piece: [float(f"{quote(runs):.4g}") for quote in quotes] for piece, quotes in QUOTES.get(name, {}).items()}


def look_at(path: Path) -> str:
    """What a scenario's comment tells to look at, on one line."""
    lines = path.read_text(encoding="utf-8").split("title =")[0].splitlines()
    return " ".join(" ".join(line.removeprefix("#").strip() for line in lines).split("What to look at:")[1].split())


def errors(comment: str, record: Mapping[str, list[float]]) -> list[str]:
    """What a comment quotes otherwise than its record has it, and what no run gives."""
    found, rest = [], comment
    for piece, values in record.items():
        if piece not in comment:
            found.append(f"{piece!r} is not in the comment")
            continue
        rest = rest.replace(piece, " ")
        for number, value in zip(NUMBER.findall(piece), values, strict=True):
            rounded = f"{value:z.{len(number.partition('.')[2])}f}"
            if rounded != number:
                found.append(f"{piece!r}: the run has {rounded}")
    return found + [f"{number}: no run gives this number; add it to QUOTES" for number in WITH_UNIT.findall(rest)]


def comments(folder: Path = ROOT / "scenarios") -> dict[str, str]:
    """What to look at, by scenario."""
    return {path.stem: look_at(path) for path in sorted(folder.glob("*.toml"))}
