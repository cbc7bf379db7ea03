"""Geometry of the scans of a log: place of each reading on the printer's grid, by shift, drift and a linear part.

Signs and terms are those of the observer (`controller/core/observer/scan_view.h`): the reading of cell (i, j) is the
surface at (i + s_x + a u + b w, j + s_y + c u + d w), interpolated by straight lines, beyond the grid as at its border;
u and w run from -1 to 1 over the grid. The observer follows the geometry from scan to scan within a print. A log is
known as a whole: one linear part for all its scans and a shift that drifts evenly are estimated from all layers at once
(`ink_regression`), in NumPy, since there is no time limit and the observer's fit knows a single scan.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse import csr_array

from inkloop.component import FloatMap

TERMS = 8  # shift along x and y, linear part (4), drift along x and y
HALF_STEP = 0.3  # of the difference quotients that slopes are [cells]; as in the observer
LONGEST_MOVE = 0.5  # longest Gauss-Newton step [cells] (assumed)
PRIOR_STD = (0.7, 0.02, 0.5)  # of shift [cells], linear part [1] and drift [cells] before the scans (assumed)


@dataclass(frozen=True, eq=False)
class ScanGeometry:
    """Geometry of all scans of a print of (nx, ny) cells and so many layers.

    terms: (8,) [cells]: shift along x and y in the middle of the print; linear part at u = 1 and w = 1 along x, then
    along y; drift of the shift along x and y from the middle to the last layer, and with opposite sign at the first
    one.
    """

    shape: tuple[int, int]
    layers: int
    terms: NDArray[np.float64]

    @classmethod
    def in_register(cls, shape: tuple[int, int], layers: int) -> ScanGeometry:
        """Geometry of scans in register."""
        return cls(shape, layers, np.zeros(TERMS))

    @property
    def is_none(self) -> bool:
        """Whether the scans count as in register."""
        return not self.terms.any()

    @property
    def farthest(self) -> float:
        """Largest distance of a reading from its cell, after the first and the last layer [cells]."""
        cells = np.indices(self.shape).reshape(2, -1)
        return float(max(np.linalg.norm(self.places(k) - cells, axis=0).max() for k in (1, self.layers)))

    @property
    def prior_precision(self) -> NDArray[np.float64]:
        """(8,) of the terms before the scans [1/cells^2]."""
        half = [0.5 * (count - 1) for count in self.shape]
        shift, linear, drift = PRIOR_STD
        return np.array([shift, shift, *2 * [linear * half[0], linear * half[1]], drift, drift]) ** -2.0

    @property
    def linear(self) -> NDArray[np.float64]:
        """(2, 2): displacement per cell of distance (x, y) from the middle of the grid [1]."""
        return self.terms[2:6].reshape(2, 2) / (0.5 * (np.array(self.shape) - 1.0))

    def moved(self, by: NDArray[np.float64]) -> ScanGeometry:
        """With (8,) other terms [cells]."""
        return replace(self, terms=self.terms + by)

    def describe(self) -> str:
        """Description of the geometry, as the end of a sentence that begins with "the scans"."""
        if self.is_none:
            return "lie in register"
        (a, b), (c, d) = self.linear
        shift, drift = self.terms[:2], 2.0 * self.terms[6:]
        return (
            f"lie {shift[0]:+.2f} cells along x and {shift[1]:+.2f} along y, drift by {drift[0]:+.2f} and "
            f"{drift[1]:+.2f} over the print, are rotated by {np.degrees((c - b) / 2.0):+.2f} degrees, magnified by "
            f"{50.0 * (a + d):+.1f} % and sheared by {100.0 * (b + c):+.1f} %"
        )

    def share_of_time(self, scan: int) -> float:
        """From -1 at the first printed layer to 1 at the last one; 0 of a single one."""
        return max(2.0 * (scan - 1) / (self.layers - 1) - 1.0, -1.0) if self.layers > 1 else 0.0

    def places(self, scan: int) -> NDArray[np.float64]:
        """(2, cells): places of the readings of a scan [cells]."""
        u, w = _across(self.shape)
        shift = self.terms[:2] + self.share_of_time(scan) * self.terms[6:]
        moved = np.stack([np.ones(u.size), u, w])
        to = np.column_stack([shift, self.terms[2:6].reshape(2, 2)])
        return np.asarray(np.indices(self.shape).reshape(2, -1) + to @ moved)

    def sampling(self, scan: int) -> csr_array:
        """(cells, cells): matrix from the surface to the readings of a scan."""
        cells = self.shape[0] * self.shape[1]
        if self.is_none:
            return _identity(cells)
        last = np.array(self.shape)[:, None] - 1
        place = np.clip(self.places(scan), 0, last)
        first = np.minimum(place.astype(np.intp), np.maximum(last - 1, 0))
        beyond, second = place - first, np.minimum(first + 1, last)
        rows, columns, weights = [], [], []
        for i, s in ((first[0], 1.0 - beyond[0]), (second[0], beyond[0])):
            for j, t in ((first[1], 1.0 - beyond[1]), (second[1], beyond[1])):
                rows.append(np.arange(cells))
                columns.append(i * self.shape[1] + j)
                weights.append(s * t)
        entries = np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))
        return csr_array(entries, shape=(cells, cells))

    def slopes(self, scan: int, surface: FloatMap) -> NDArray[np.float64]:
        """(2, cells): slope of the surface along x and y at the readings of a scan [m per cell]."""
        at = self.places(scan)
        found = []
        for step in HALF_STEP * np.eye(2)[:, :, None]:
            further, before = (map_coordinates(surface, at + s * step, order=1, mode="nearest") for s in (1.0, -1.0))
            found.append((further - before) / (2.0 * HALF_STEP))
        return np.array(found)

    def sensitivity(self, scan: int, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(8, cells): derivatives of the readings of a scan with respect to the terms [m per cell]."""
        u, w = _across(self.shape)
        along_x, along_y = slopes
        time = self.share_of_time(scan)
        linear = (along_x * u, along_x * w, along_y * u, along_y * w)
        return np.stack([along_x, along_y, *linear, time * along_x, time * along_y])


@dataclass(frozen=True, eq=False)
class GeometryFit:
    """Normal equations of a geometry about its present terms. weighted: (8, n) sensitivity of the predictions to them,
    times the weights of the errors; inverse: (8, 8) of their information.
    """

    geometry: ScanGeometry
    weighted: NDArray[np.float64]
    inverse: NDArray[np.float64]

    @classmethod
    def of(cls, geometry: ScanGeometry, sensitivity: NDArray[np.float64], weight: NDArray[np.float64]) -> GeometryFit:
        """Normal equations of (n,) errors with these weights."""
        weighted = sensitivity * weight
        information = weighted @ sensitivity.T + np.diag(geometry.prior_precision)
        return cls(geometry, weighted, np.asarray(np.linalg.inv(information), np.float64))

    def step(self, error: NDArray[np.float64]) -> NDArray[np.float64]:
        """(8,): change of the terms by (n,) errors, limited in length [cells]."""
        step = self.inverse @ (self.weighted @ error - self.geometry.prior_precision * self.geometry.terms)
        return np.asarray(step * min(1.0, LONGEST_MOVE / max(float(np.abs(step).max()), LONGEST_MOVE)))


@lru_cache(maxsize=8)
def _identity(cells: int) -> csr_array:
    return csr_array((np.ones(cells), np.arange(cells), np.arange(cells + 1)), shape=(cells, cells))


@lru_cache(maxsize=8)
def _across(shape: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates u and w of the cells, (cells,) each: from -1 to 1 over the grid."""
    u, w = (np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1) for count in shape)
    return np.repeat(u, shape[1]), np.tile(w, shape[0])
