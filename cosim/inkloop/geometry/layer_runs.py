"""From slices to columns: equal labels of a cell in consecutive slices become one interval."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from inkloop.geometry.columns import Columns

Labels = NDArray[np.int8]


def columns_of_layers(
    layers: Iterable[Labels], nx: int, ny: int, pitch: float, thickness: float, *, labels: int
) -> list[Columns]:
    """Columns of all labels together, then of each label from 1 to `labels`.

    layers: (nx, ny) each, from the substrate up, 0 for empty cells; pitch: of the cells; thickness: of a layer [m].
    """
    before, since = np.zeros(nx * ny, np.int8), np.zeros(nx * ny, np.int64)
    runs: list[tuple[NDArray[np.intp], Labels, NDArray[np.int64], int]] = []
    number = 0

    def end_runs(now: Labels) -> None:
        changed = np.flatnonzero(now != before)
        ended = changed[before[changed] > 0]
        runs.append((ended, before[ended], since[ended], number))
        since[changed], before[changed] = number, now[changed]

    for layer in layers:
        end_runs(layer.ravel())
        number += 1
    end_runs(np.zeros(nx * ny, np.int8))
    cell, label, begin = (np.concatenate(parts) for parts in list(zip(*runs, strict=True))[:3])
    end = np.repeat([run[3] for run in runs], [run[0].size for run in runs])
    chosen = [np.ones(cell.size, np.bool_), *(label == each for each in range(1, labels + 1))]
    return [
        Columns.of_intervals(nx, ny, pitch, cell[some], begin[some] * thickness, end[some] * thickness)
        for some in chosen
    ]
