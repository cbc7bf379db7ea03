"""Logs of the rig's plant as its profiler reads it, for identification."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from inkloop.units import M_PER_UM
from inkloop_lab.identify.print_record import PrintRecord
from support.lying_scans.parts import PITCH_UM
from support.lying_scans.plant import Plant, printed
from support.lying_scans.profiler import Profiler, Scan, read, shown

EVEN = Plant(variation=0.0)


def logged(
    profiler: Profiler, drops: Sequence[Any], seed: int = 0, plant: Plant = EVEN, name: str = "log"
) -> PrintRecord:
    """The record of a print from flat ground; drops: by layer (nx, ny) volumes, whose places are the pattern."""
    for_plant, for_profiler = np.random.default_rng(seed).spawn(2)
    height, scans, measured = np.zeros(drops[0].shape), list[Scan](), []
    for layer in range(len(drops) + 1):
        done = layer / len(drops)
        scans.append(read(profiler, height, layer, done, for_profiler))
        z, valid = shown(profiler, scans)
        measured.append(np.where(valid, z * M_PER_UM, np.nan))
        if layer < len(drops):
            height = printed(plant, height, np.asarray(drops[layer], float), layer + 1, done, for_plant)
    pattern = np.stack([(each > 0).astype(np.int32) for each in drops])
    return PrintRecord(name, PITCH_UM * M_PER_UM, pattern, np.stack(measured))
