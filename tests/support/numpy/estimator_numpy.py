"""The height estimator for one ink without registration, stated in NumPy to check controller/core/estimator.

Kalman filter per cell, drift plane from the unprinted cells, share of the ink by instrumental variables. The layer map
is lu_numpy's; what single droplets add is found by printing each alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from inkloop.component import Ink, Job
from support.numpy import lu_numpy

DROPLET_STD, SURPRISE = 0.1, 5.0
LEVERAGE_MAX, LEAST_CELLS = 0.25, 8
PRIOR_STD, FORGETTING = 0.5, 0.8


@dataclass(frozen=True)
class State:
    """Maps (nx, ny) [m], [m^2], layers; share of the nominal ink [1]; its evidence: response, covariance, surplus."""

    height: Any
    variance: Any
    unseen: Any
    scale: float
    evidence: tuple[float, float, float]
    noise: float
    scans: int


def near(marked: Any) -> Any:
    """Cells that are marked or touch a marked one."""
    framed = np.pad(marked, 1)
    return np.lib.stride_tricks.sliding_window_view(framed, (3, 3)).any(axis=(2, 3))


def drift(scan: Any, known: Any, part: Any, valid: Any) -> tuple[Any, float | None]:
    """(plane over the grid [m], variance of the readings about it [m^2] or None) of the cells out of reach of the part.

    Least absolute values by reweighting, then least squares of what lies within three robust standard deviations; a
    plane, an offset or nothing, as far as the cells determine it over the part.
    """
    cells = valid & ~near(part)
    i, j = np.indices(part.shape) / max(part.shape) - 0.5
    terms = np.stack([np.ones(part.shape), i, j], axis=-1)
    for count in (3, 1):
        A, rise = terms[cells][:, :count], (scan - known)[cells]
        if len(A) < 3 or np.linalg.matrix_rank(A) < count:
            continue
        leverage = np.einsum("ki,ij,kj->k", terms[part][:, :count], np.linalg.inv(A.T @ A), terms[part][:, :count])
        if leverage.max() > LEVERAGE_MAX:
            continue
        weight = np.ones(len(A))
        for _ in range(8):
            root = np.sqrt(weight)[:, None]
            x = np.linalg.lstsq(root * A, root[:, 0] * rise, rcond=None)[0]
            distance = np.abs(rise - A @ x)
            least = max(0.1 * float(np.median(distance)), 1e-12)
            weight = least / np.maximum(distance, least)
        kept = distance <= max(3.0 * 1.4826 * float(np.median(distance)), 1e-12)
        x = np.linalg.lstsq(A[kept], rise[kept], rcond=None)[0]
        enough = kept.sum() >= LEAST_CELLS
        variance = float(np.sum((rise - A @ x)[kept] ** 2) / (kept.sum() - count)) if enough else None
        return terms[..., :count] @ x, variance
    return np.zeros(part.shape), None


class Estimator:
    """`noise`: of a reading [m^2], None where it is learnt; `scale` of the ink is learnt if `adapts`."""

    def __init__(self, job: Job, noise: float | None, adapts: bool = True) -> None:
        ink: Ink = job.inks[0]
        self.part, self.passes, self.noise, self.adapts = job.mask, job.passes, noise, adapts
        self.ink = np.array([ink.h1, ink.h2, ink.h3])
        self.full = float(self.ink @ [1.0, 4.0, 4.0])

    def printed(self, height: Any, pattern: Any, scale: float) -> Any:
        """The surface after a layer of ink with this share of the nominal heights."""
        ink = tuple(scale * self.ink)
        return lu_numpy.layer(height, pattern, (ink, ink), passes=self.passes)[0]

    def squares(self, height: Any, pattern: Any, scale: float) -> Any:
        """Sum over the droplets of the squares of what each adds to a cell [m^2]."""
        ink, found, i, j = tuple(scale * self.ink), np.zeros(height.shape), *np.indices(height.shape)
        for colour in range(4) if self.passes == 4 else [None]:
            now = pattern if colour is None else np.where(2 * (i % 2) + j % 2 == colour, pattern, 0)
            for cell in zip(*np.nonzero(now), strict=True):
                single = np.zeros_like(pattern)
                single[cell] = 1
                found += (lu_numpy.one_pass(height, single, (ink, ink))[0] - height) ** 2
            height = lu_numpy.one_pass(height, now, (ink, ink))[0]
        return found

    def first(self, scan: Any, valid: Any) -> State:
        noise = self.noise or 0.0
        height, variance = np.where(valid, scan, 0.0), np.where(valid, noise, self.full**2)
        return State(height, variance, (~valid).astype(int), 1.0, (0.0, 0.0, 0.0), noise, 1)

    def next(self, before: State, pattern: Any, scan: Any, valid: Any) -> State:
        scan = np.where(valid, scan, 0.0)
        plane, shown = drift(scan, before.height, self.part, valid)
        scan, noise = scan - plane, self._noise(before, shown)
        learns = self.noise is None and before.scans == 1
        known = np.where(learns & (before.unseen == 0), noise, before.variance)
        scale, evidence, spread = before.scale, before.evidence, known
        for _ in range(5):
            widths = scale
            spread = known + DROPLET_STD**2 * self.squares(before.height, pattern, widths)
            evidence = self._evidence(before, pattern, widths, scan, valid, spread + noise)
            scale = self._scale(evidence)
            if abs(scale - widths) <= 0.01 * widths:
                break
        predicted = self.printed(before.height, pattern, scale)
        surprise = (scan - predicted) ** 2
        spread_of_seen = np.where(surprise > SURPRISE**2 * (spread + noise), surprise, spread)
        gain = np.where(valid, spread_of_seen / (spread_of_seen + noise) if noise > 0.0 else 1.0, 0.0)
        variance = np.where(valid, (1.0 - gain) * spread_of_seen, spread)
        unseen = np.where(valid, 0, before.unseen + 1)
        height = predicted + gain * (scan - predicted)
        return State(height, variance, unseen, scale, evidence, noise, before.scans + 1)

    def _noise(self, before: State, shown: float | None) -> float:
        """Of a reading: the mean over the scans; the known heights, a mean of n scans, add 1 / n of it."""
        if self.noise is not None:
            return self.noise
        if shown is None:
            return before.noise
        n = before.scans
        return (1.0 - 1.0 / n) * before.noise + shown / (1.0 + 1.0 / n) / n

    def _evidence(
        self, before: State, pattern: Any, widths: float, scan: Any, valid: Any, variance: Any
    ) -> tuple[float, float, float]:
        """The sums with those of a layer: of instrument times what the nominal ink adds with these widths, ..."""
        growth = scan - before.height
        adds = (self.printed(before.height, pattern, widths) - before.height) / widths
        ink = tuple(before.scale * self.ink)
        flat = lu_numpy.one_pass(np.zeros(growth.shape), pattern, (ink, ink))[0] / before.scale  # in one pass
        seen, learnt = self.part & valid, before.scale
        hit = seen & (pattern > 0)
        if not self.adapts or hit.sum() < 20 or learnt * adds[seen].mean() < 0.1 * self.full:
            return before.evidence
        usual = 1.0 if any(before.evidence) else float(np.median(growth[hit] / adds[hit]))
        expected = usual * learnt * adds
        strange = hit & (np.abs(growth - expected) > np.maximum(0.6 * np.abs(expected), 3.0 * np.sqrt(variance)))
        used = seen & ~near(strange)
        if not used.any():
            return before.evidence
        z = np.where(used & (flat > 0.0), flat[used].mean(), 0.0)
        response, covariance, surplus = before.evidence
        return (
            FORGETTING * response + float(np.sum(z * adds)),
            FORGETTING**2 * covariance + float(np.sum(z * z * variance)),
            FORGETTING * surplus + float(np.sum(z * (growth - adds))),
        )

    def _scale(self, evidence: tuple[float, float, float]) -> float:
        """Normal prior about 1, within a quarter and four."""
        response, covariance, surplus = evidence
        if covariance == 0.0:
            return 1.0
        information = response**2 / covariance + 1.0 / PRIOR_STD**2
        return float(np.clip(1.0 + response * surplus / covariance / information, 0.25, 4.0))
