"""Slices of a part on the grid: the places of their pixels, and the columns of the stack, in which equal labels of a
cell in consecutive slices are one interval.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from inkloop.geometry.columns import Columns
from inkloop.tables.shapes import Bounds, Grid, PartError, Solid

EDGE = 1e-6
"""Share of the pitch within which a wall counts as being on the centres of cells."""


class Slices:
    """Lays slices on the grid, one after the other, the middle of their pixels at `center`.

    A cell takes the pixel that contains its centre. pixel, center: along x and y [m].
    """

    def __init__(self, grid: Grid, center: tuple[float, float], pixel: tuple[float, float]) -> None:
        self._grid, self._center, self._pixel = grid, center, pixel
        self._first = ""
        self._shape: tuple[int, ...] = ()
        self._filled = [np.zeros(0, np.bool_), np.zeros(0, np.bool_)]
        self._pixels_filled = 0

    def solid(self, slices: Iterable[tuple[str, Labels]], thickness: float) -> Solid:
        """The part of slices from the substrate up, each with its place in the files. Raises PartError.

        A slice is (pixels along x, along y): 0 none, 1 ink A, 2 ink B. thickness: of a slice [m].
        """
        nx, ny, pitch = self._grid.nx, self._grid.ny, self._grid.pitch
        layers = (self._on_grid(place, labels) for place, labels in slices)
        whole, of_a, of_b = columns_of_layers(layers, nx, ny, pitch, thickness, labels=2)
        volume = self._pixels_filled * self._pixel[0] * self._pixel[1] * thickness
        return Solid(whole, self._bounds(), of_a if of_b.mask.any() else None, tuple(self._remarks()), volume)

    def _on_grid(self, place: str, labels: Labels) -> Labels:
        self._note(place, labels)
        i, j = (np.floor(self._positions(axis)).astype(np.intp) for axis in (0, 1))
        on_grid = labels[np.ix_(i.clip(0, labels.shape[0] - 1), j.clip(0, labels.shape[1] - 1))]
        off = [(k < 0) | (k >= count) for k, count in zip((i, j), labels.shape, strict=True)]
        return np.where(off[0][:, None] | off[1], np.int8(0), on_grid)

    def _bounds(self) -> Bounds:
        """The box around the filled pixels."""
        edges: list[float] = []
        for axis, filled in enumerate(self._filled):
            used = np.flatnonzero(filled)
            first, last = (int(used[0]), int(used[-1]) + 1) if used.size else (0, 0)
            start = self._start(axis) if used.size else 0.0
            edges += [start + first * self._pixel[axis], start + last * self._pixel[axis]]
        return Bounds(*edges)

    def _remarks(self) -> Iterator[str]:
        """A sentence for each direction in which centres of cells lie between two pixels."""
        for axis, name in enumerate("xy"):
            position = self._positions(axis)
            if np.any(np.abs(position - np.round(position)) * self._pixel[axis] < EDGE * self._grid.pitch):
                yield (
                    f"along {name}, centres of cells lie between two pixels, which rounding decides; shift the part by "
                    f"a fraction of a pixel (center_{name}_um)"
                )

    def _start(self, axis: int) -> float:
        """Where the slices begin on the grid [m]."""
        return self._center[axis] - self._shape[axis] / 2 * self._pixel[axis]

    def _positions(self, axis: int) -> NDArray[np.float64]:
        """Centres of the cells, in pixels from the first edge."""
        count = (self._grid.nx, self._grid.ny)[axis]
        return np.asarray((np.arange(count) * self._grid.pitch - self._start(axis)) / self._pixel[axis], np.float64)

    def _note(self, place: str, labels: Labels) -> None:
        """Check the size of a slice and widen the box around what is filled. Raises PartError."""
        if not self._first:
            self._first, self._shape = place, labels.shape
            self._filled = [np.zeros(count, np.bool_) for count in labels.shape]
        if labels.shape != self._shape:
            sizes = [" x ".join(map(str, shape)) for shape in (labels.shape, self._shape)]
            raise PartError(
                [
                    f"files: {place} has {sizes[0]} pixels along x and y, {self._first} has {sizes[1]}; "
                    "save all slices in one size"
                ]
            )
        for axis in (0, 1):
            self._filled[axis] |= labels.any(axis=1 - axis)
        self._pixels_filled += int(np.count_nonzero(labels))


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
