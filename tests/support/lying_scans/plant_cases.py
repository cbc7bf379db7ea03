"""Printers whose droplets fall otherwise than planned, seen by an exact profiler.

Where the design asks for "as today", the figures are what this rig found at 6db4c0d9, rounded up.
"""

from __future__ import annotations

from typing import Any

from support.lying_scans.case import Case, Must
from support.lying_scans.plant import CAP, WIDE, Plant
from support.lying_scans.scan_cases import own

BLED = Must(1.0, lowest=-12.0)


def fallen(name: str, must: Must, **plant: Any) -> Case:
    """The standard print with these peculiarities of the printer alone."""
    return Case(name, must, Plant(**plant))


CASES = (
    fallen("ink bleeds down walls, 15 %", BLED, bleeding=0.15),
    fallen("ink bleeds down walls, 5 %", own(BLED), bleeding=0.05),
    fallen("satellites 1 %", Must(0.40, 5.0, trusted=True), satellites=0.01),
    fallen("satellites 3 %", own(Must(0.60, 8.0)), satellites=0.03),
    fallen("volume falls by 30 %", Must(0.37), volume_loss=0.3),
    fallen("volume rises by 30 %", own(Must(1.2)), volume_loss=-0.3),
    fallen("volume 15 % more to the right", Must(0.90), volume_right=0.15),
    fallen("volume 15 % less to the right", own(Must(0.90)), volume_right=-0.15),
    fallen("shrinks as a whole, 0.97", Must(4.5, or_stops=True), kept=0.97),
    fallen("shrinks as a whole, 0.99", own(Must(1.5, or_stops=True)), kept=0.99),
    Case("no flow, caps known", own(Must(1.05, 5.0)), Plant(CAP, flows=False), ink=CAP),
    fallen("no flow", own(Must(2.0, 9.0)), flows=False),
    fallen("droplets reach 2 cells", own(Must(0.75, 3.0)), droplet=WIDE),
    fallen("droplets land 0.2, -0.1 cells off", own(Must(2.0, 3.0)), placement=(0.2, -0.1)),
    fallen("droplets land -0.5, 0 cells off", own(Must(4.2)), placement=(-0.5, 0.0)),
    fallen("lines along x retract by 4 %", own(Must(3.4, 9.0)), contraction=(0.04, 0.0)),
    fallen("dead row from layer 5", own(Must(6.5)), dry_rows=(12, 12), dry_from=5),
    Case("grey head, drops 1 to 4", own(Must(0.16)), drop_levels=4, options={"drop_levels": 4}),
)
