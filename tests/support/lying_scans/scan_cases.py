"""Scans with the errors of real profilers: shifts, rotations, levelling, spikes, missing readings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from support.lying_scans.case import Case, Must
from support.lying_scans.plant import Plant
from support.lying_scans.profiler import Profiler

OBLONG, UPRIGHT = (37, 25), (25, 37)
SHIFTED, PLACED, BENT = Must(0.31, 2.0), Must(0.33, 2.0), Must(0.36)
REALISTIC = Profiler(noise=0.5, offset=3.0, tilt=3.0, bow=1.0, jitter=0.5, step=0.5)
DISPLACED = replace(REALISTIC, shift=(0.25, 0.1), rotation=0.5, magnification=0.01)
WITH_SPIKES = replace(DISPLACED, spikes=0.02)
WITH_GAPS = replace(DISPLACED, dropouts=0.05, missing_every=3)


def scanned(name: str, must: Must, **faults: Any) -> Case:
    """The standard print with these faults of the profiler alone."""
    return Case(name, must, profiler=Profiler(**faults))


def own(must: Must) -> Must:
    """The same, by analogy."""
    return replace(must, own=True)


IN_REGISTER = (
    Case("in register, 20 %", Must(0.30, 2.0)),
    Case("in register, 40 %", Must(0.54, 3.0), Plant(variation=0.4)),
    scanned("noise 1 um", Must(0.33), noise=1.0),
    scanned("noise 2 um", own(Must(0.45)), noise=2.0),
    scanned("rows along y jitter 1 um", Must(0.42), jitter=1.0),
    scanned("rows along x jitter 1 um", Must(0.42), jitter=1.0, jitter_axis=1),
    scanned("rows along y jitter 2 um", own(Must(0.70)), jitter=2.0),
    scanned("steps of 0.5 um", Must(0.34), step=0.5),
    scanned("steps of 1 um", own(Must(0.40)), step=1.0),
    scanned("spot 1 cell", own(Must(0.38, 2.5)), spot=1.0),
    scanned("spot 0.5 cells", own(Must(0.32, 2.0)), spot=0.5),
)
SHIFTS = (
    scanned("shift 0.1, 0", SHIFTED, shift=(0.1, 0.0)),
    scanned("shift 0, -0.25", SHIFTED, shift=(0.0, -0.25)),
    scanned("shift 0.25, 0.25", SHIFTED, shift=(0.25, 0.25)),
    scanned("shift -0.5, 0.5", SHIFTED, shift=(-0.5, 0.5)),
    scanned("shift 1, 0", SHIFTED, shift=(1.0, 0.0)),
    scanned("shift 0, -2", SHIFTED, shift=(0.0, -2.0)),
    scanned("shift drifts from 0 to 1, 0", SHIFTED, drift=(1.0, 0.0)),
    scanned("shift drifts from 0.4, -0.7 to -0.4, 0.7", own(SHIFTED), shift=(0.4, -0.7), drift=(-0.8, 1.4)),
    scanned("shift scatters by 0.1", SHIFTED, shift_std=0.1),
    scanned("shift 0.33, -0.25 scatters by 0.3", own(Must(0.36, 3.0)), shift=(0.33, -0.25), shift_std=0.3),
    Case("37 x 25, shift 0.5, -0.25", own(SHIFTED), profiler=Profiler(shift=(0.5, -0.25)), shape=OBLONG),
    Case("25 x 37, shift 0.5, -0.25", own(SHIFTED), profiler=Profiler(shift=(0.5, -0.25)), shape=UPRIGHT),
)
GEOMETRY = (
    scanned("rotation 0.5 degrees", PLACED, rotation=0.5),
    scanned("rotation -0.5 degrees", PLACED, rotation=-0.5),
    scanned("rotation 2 degrees", PLACED, rotation=2.0),
    scanned("rotation -2 degrees", PLACED, rotation=-2.0),
    scanned("rotation 0.2 degrees", own(PLACED), rotation=0.2),
    scanned("rotation 1 degree", own(PLACED), rotation=1.0),
    scanned("magnification 1 %", PLACED, magnification=0.01),
    scanned("magnification 3 %", PLACED, magnification=0.03),
    scanned("magnification -1 %", PLACED, magnification=-0.01),
    scanned("magnification -3 %", PLACED, magnification=-0.03),
    scanned("magnification -2 %", own(PLACED), magnification=-0.02),
    scanned("shear 1 %", own(PLACED), shear=0.01),
    scanned("shear -2 %", own(PLACED), shear=-0.02),
    Case("37 x 25, rotation 1 degree", own(PLACED), profiler=Profiler(rotation=1.0), shape=OBLONG),
    Case("25 x 37, rotation -1 degree", own(PLACED), profiler=Profiler(rotation=-1.0), shape=UPRIGHT),
    Case("bar 25 x 37, rotation 0.5 degrees", own(PLACED), profiler=Profiler(rotation=0.5), part="bar", shape=UPRIGHT),
)
DATUM = (
    scanned("levelled anew: offset and tilt 3 um", Must(0.34), offset=3.0, tilt=3.0),
    scanned("levelled anew: bow 2 um", Must(0.34), bow=2.0),
    scanned("levelled anew: offset and tilt 10 um", own(Must(0.34)), offset=10.0, tilt=10.0),
    scanned("levelled anew: bow 5 um", own(Must(0.34)), bow=5.0),
    Case("substrate bows 10 um", BENT, Plant(bow=10.0)),
    Case("substrate bows -10 um", BENT, Plant(bow=-10.0)),
    Case("substrate bows 20 um", own(BENT), Plant(bow=20.0)),
    Case("37 x 25, substrate bows -10 um", own(BENT), Plant(bow=-10.0), shape=OBLONG),
)
READINGS = (
    scanned("spikes of 20 um, 2 %", Must(0.42, 5.0), spikes=0.02),
    scanned("spikes of 50 um, 0.5 %", own(Must(0.42, 5.0)), spikes=0.005, spike_height=50.0),
    scanned("spikes of 20 um, 5 %", own(Must(0.60, 6.0)), spikes=0.05),
    scanned("walls missing", Must(0.35, trusted=True), walls_missing=12.0),
    scanned("walls missing, noise 1 um", own(Must(0.42, trusted=True)), walls_missing=12.0, noise=1.0),
    scanned("every third scan missing", Must(0.32, trusted=True), missing_every=3),
    scanned("every second scan missing", own(Must(0.34, trusted=True)), missing_every=2),
    scanned("drop-outs 10 %", own(Must(0.32, trusted=True)), dropouts=0.1),
)
TOGETHER = (
    Case("realistic", Must(0.36, 2.0), profiler=REALISTIC),
    Case("realistic, displaced", Must(0.38, 3.0), profiler=DISPLACED),
    Case("realistic, displaced, spikes", Must(0.45, 4.0), profiler=WITH_SPIKES),
    Case("realistic, displaced, drop-outs, every third missing", Must(0.45, 4.0), profiler=WITH_GAPS),
    Case("realistic, displaced, spikes, drop-outs, every third missing", own(Must(0.50, 5.0)),
         profiler=replace(WITH_GAPS, spikes=0.02)),
    Case("37 x 25, realistic, displaced", own(Must(0.38, 3.0)), profiler=DISPLACED, shape=OBLONG),
    Case("letter F, realistic, displaced", own(Must(0.45, 3.0)), profiler=DISPLACED, part="letter F"),
)  # fmt: skip
THIN = (
    Case("wall of 1 cell along x, noise 0.5, shift 0.25", Must(0.55, 2.0),
         profiler=Profiler(noise=0.5, shift=(0.25, 0.25)), part="wall of 1 cell along x"),
    Case("wall of 1 cell along y, noise 0.5, shift 0.25", Must(0.55, 2.0),
         profiler=Profiler(noise=0.5, shift=(0.25, 0.25)), part="wall of 1 cell along y"),
    Case("wall of 1 cell along x, exact", own(Must(0.55, 2.0)), part="wall of 1 cell along x"),
    Case("pillars, noise 1, shift 0.25", Must(1.1, 4.0), profiler=Profiler(noise=1.0, shift=(0.25, 0.0)),
         part="pillars"),
    Case("pillars, exact", own(Must(1.1, 4.0)), part="pillars"),
    Case("wall of 2 cells along x, realistic, displaced", Must(0.40, 3.0), profiler=DISPLACED,
         part="wall of 2 cells along x"),
    Case("wall of 2 cells along y, realistic, displaced", Must(0.40, 3.0), profiler=DISPLACED,
         part="wall of 2 cells along y"),
)  # fmt: skip
CASES = (*IN_REGISTER, *SHIFTS, *GEOMETRY, *DATUM, *READINGS, *TOGETHER, *THIN)
