"""Scans that do not show what was printed, and heads that do not print: the print must stop, and say why."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from support.lying_scans.case import STOPS_AT_ALL, Case, Must
from support.lying_scans.plant import Plant
from support.lying_scans.profiler import Profiler
from support.lying_scans.scan_cases import DISPLACED, OBLONG, REALISTIC, UPRIGHT, own, scanned

WITHIN = 4  # layers from the fault
HIGHEST_UM = 3.0
UNTRUSTED_BY = 5
ALL_ROWS = (0, 24)


def stops(first: int, own: bool = False) -> Must:
    """Stop within four layers of the first one that is wrong, with nothing too high."""
    return Must(highest=HIGHEST_UM, stop_by=first + WITHIN, own=own)


def turned(name: str, must: Must, turn: str, **fields: Any) -> Case:
    """Exact scans in another orientation of the grid."""
    return Case(name, must, profiler=Profiler(turned=turn), **fields)


WHEN_IT_TELLS = Must(highest=HIGHEST_UM, stop_by=STOPS_AT_ALL)
BY_LAYER_3 = Must(highest=HIGHEST_UM, stop_by=3)
NOT_GROWING = (
    scanned("scans frozen from layer 10", stops(10), frozen_from=10),
    scanned("scans frozen from layer 1", stops(1), frozen_from=1),
    Case("realistic, scans frozen from layer 10", stops(10, own=True), profiler=replace(REALISTIC, frozen_from=10)),
    Case("realistic, displaced, scans frozen from layer 18", stops(18, own=True),
         profiler=replace(DISPLACED, frozen_from=18)),
    scanned("all scans zero", stops(1), zero=True),
    Case("head dry from layer 10", stops(10), Plant(dry_rows=ALL_ROWS, dry_from=10)),
    Case("head dry from layer 1", stops(1, own=True), Plant(dry_rows=ALL_ROWS, dry_from=1)),
    Case("realistic, head dry from layer 10", stops(10, own=True), Plant(dry_rows=ALL_ROWS, dry_from=10), REALISTIC),
)  # fmt: skip
TURNED = (
    *(turned(f"scans {turn}", WHEN_IT_TELLS, turn) for turn in ("mirrored in x", "mirrored in y", "transposed")),
    *(turned(f"scans {turn}", own(WHEN_IT_TELLS), turn) for turn in ("turned by 90", "turned by 180")),
    turned("37 x 25, scans mirrored in x", own(WHEN_IT_TELLS), "mirrored in x", shape=OBLONG),
    turned("25 x 37, scans mirrored in y", own(WHEN_IT_TELLS), "mirrored in y", shape=UPRIGHT),
    turned("letter F, scans turned by 180", BY_LAYER_3, "turned by 180", part="letter F"),
    turned("letter F, scans turned by 90", own(BY_LAYER_3), "turned by 90", part="letter F"),
    turned("letter F, scans mirrored in x", own(BY_LAYER_3), "mirrored in x", part="letter F"),
    turned("letter F, scans mirrored in y", own(BY_LAYER_3), "mirrored in y", part="letter F"),
    Case("letter F, realistic, scans turned by 180", own(BY_LAYER_3),
         profiler=replace(REALISTIC, turned="turned by 180"), part="letter F"),
)  # fmt: skip
LATE = (
    scanned("scans one layer late", stops(1), late=1),
    scanned("scans two layers late", stops(1, own=True), late=2),
    Case("realistic, scans one layer late", stops(1, own=True), profiler=replace(REALISTIC, late=1)),
)
SCALED = (
    scanned("height gain 2 %", Must(3.1), gain=1.02),
    scanned("height gain -2 %", own(Must(3.1)), gain=0.98),
    scanned("height gain 0.5", Must(untrusted_by=UNTRUSTED_BY), gain=0.5),
    Case("volume 0.45 of nominal", own(Must(untrusted_by=UNTRUSTED_BY)), Plant(volume=0.45)),
)
CASES = (*NOT_GROWING, *TURNED, *LATE, *SCALED)
