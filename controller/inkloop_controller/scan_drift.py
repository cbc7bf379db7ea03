"""What the sensor's frame did between two scans, told by cells that no droplet reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop_controller.criterion import beside

LEVERAGE_MAX = 0.25  # variance that the plane may bring to a cell of the part, of a reading's (assumed)
ROUNDS = 8  # of reweighting; they more than suffice for a plane (by trial)
OUTLIER = 3.0  # robust standard deviations from which on a cell is left out
MAD = 1.4826  # standard deviation / median absolute value of a normal variable
LEAST_CELLS = 8  # cells that tell what noise is (assumed)
ROUNDING = 1e-12  # [m], heights that agree to this are equal


@dataclass(frozen=True)
class Drift:
    """plane: (nx, ny) to be taken off the scan [m]; residual_variance: of the reference cells about it [m^2], None
    where they are too few to tell.
    """

    plane: FloatMap
    residual_variance: float | None


class ScanDrift:
    """Offset and tilt of a scan against what the unprinted cells are known to be.

    They are the cells out of reach of every droplet: two cells and more from the part. What they were at first may be
    uneven or tilted and stays; only what has changed since is the sensor's. An offset there was in the very first scan
    cannot be told from the substrate. A plane is fitted where the cells surround the part well enough, an offset where
    they do not, and nothing where there are hardly any: a part that fills the grid leaves drift in the heights.
    """

    def __init__(self, part: BoolMap) -> None:
        self.cells = ~(part | beside(part))
        i, j = np.indices(part.shape)
        columns = [np.ones(part.shape), i / max(part.shape) - 0.5, j / max(part.shape) - 0.5]
        self._terms: NDArray[np.float64] = np.stack(columns, axis=-1)
        self._part = part

    def seen(self, scan: FloatMap, known: FloatMap, valid: BoolMap) -> Drift:
        """The drift in a scan (nx, ny) [m] of a surface that is `known` [m] at the reference cells."""
        used = self.cells & valid
        rise = (scan - known)[used]
        for count in (3, 1):
            terms = self._terms[used][:, :count]
            if not self._carries(terms, count):
                continue
            coefficients, kept = _robust_fit(terms, rise)
            residual = (rise - terms @ coefficients)[kept]
            variance = float(residual @ residual) / (residual.size - count) if residual.size >= LEAST_CELLS else None
            return Drift(self._terms[..., :count] @ coefficients, variance)
        return Drift(np.zeros(scan.shape), None)

    def _carries(self, terms: NDArray[np.float64], count: int) -> bool:
        """Whether the fit is good for the part: far cells in one corner tell little about it."""
        if len(terms) < 3 or np.linalg.matrix_rank(terms.T @ terms) < count:
            return False
        at = self._terms[self._part][:, :count]
        leverage = np.einsum("ci,ij,cj->c", at, np.linalg.inv(terms.T @ terms), at)
        return bool(leverage.max(initial=0.0) <= LEVERAGE_MAX)


def _robust_fit(terms: NDArray[np.float64], rise: NDArray[np.float64]) -> tuple[NDArray[np.float64], BoolMap]:
    """Least absolute values by reweighting, then least squares without the outliers: (coefficients, cells kept)."""
    weight = distance = np.ones(rise.size)
    for _ in range(ROUNDS):
        distance = np.abs(rise - terms @ _least_squares(terms, rise, weight))
        weight = 1.0 / np.maximum(distance, max(0.1 * float(np.median(distance)), ROUNDING))
    kept = distance <= max(OUTLIER * MAD * float(np.median(distance)), ROUNDING)
    return _least_squares(terms, rise, kept.astype(np.float64)), kept


def _least_squares(
    terms: NDArray[np.float64], rise: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    root = np.sqrt(weight / weight.max())
    return np.asarray(np.linalg.lstsq(terms * root[:, None], rise * root, rcond=None)[0], np.float64)
