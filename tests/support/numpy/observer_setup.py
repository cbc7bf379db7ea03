"""Grid, options and memory of the observer in NumPy, the layer map, and dense matrices for what a sensor reads."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inkloop.component import Job
from support.numpy import lu_numpy
from support.numpy import observer_constants as c


@dataclass
class State:
    """Knowledge after a scan, as in surface_estimate.h; surprised: scans in a row."""

    height: Any
    variance: Any
    ledger: Any
    last: Any
    last_valid: Any
    unseen: Any
    share: Any
    share_covariance: Any
    datum_spread: Any
    noise: Any  # variances of a reading, about the datum, and by neighbours along x and along y [m^2]
    freedom: float  # of these
    g: Any
    covariance: Any
    surprise: Any = 0.0
    surprised: Any = 0
    dead: Any = 0.0
    full: Any = None
    capped: Any = None
    high: Any = None
    ground: Any = field(default_factory=lambda: np.zeros(3))
    ground_wrong: bool = False
    variation: float = 1.0
    evidence: float = c.FIRST_EVIDENCE
    vanishing: float = 0.0
    lasting: float = 0.0
    scans: int = 1
    steps: Any = field(default_factory=lambda: np.full(2, c.FIRST_STEP**2))
    odds: float = c.FIRST_ODDS
    misfits: list[float] = field(default_factory=list)
    is_displaced: bool = False
    is_shifted: bool = False
    layers: int = 0
    early: float = 1.0
    mean_misfit: Any = field(default_factory=lambda: np.ones(2))
    doubts: Any = field(default_factory=lambda: np.zeros(9))
    volume_doubt: float = 0.0
    stop: tuple[int, int, int, float] = (0, 0, 0, 0.0)  # reason, layer, transform, figure
    is_looked_at: bool = False
    is_volume_believed: bool = False
    datum: Any = field(default_factory=lambda: np.zeros(6))
    blind: int = 0


def volumes_alone(nominal: Any, share: Any, covariance: Any) -> tuple[Any, Any]:
    """Shares of heights in nominal proportions, and their covariance: that of the volumes."""
    weights = nominal * [1.0, 4.0, 4.0] / (nominal @ [1.0, 4.0, 4.0])[:, None]
    mean = np.repeat(np.einsum("kl,ko->klo", np.eye(len(nominal)), weights).reshape(len(nominal), -1), 3, axis=0)
    return mean @ share, mean @ covariance @ mean.T + c.HELD * np.eye(len(share))


def solved(matrix: Any, side: Any) -> Any:
    """Of a positive definite matrix, whatever the units of its rows."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return scale * np.linalg.solve(matrix * np.outer(scale, scale), scale * side)


def inverse(matrix: Any) -> Any:
    return np.column_stack([solved(matrix, unit) for unit in np.eye(len(matrix))])


def near(marked: Any, times: int = 1) -> Any:
    """Cells that are marked or touch a marked one, so many times."""
    for _ in range(times):
        marked = np.lib.stride_tricks.sliding_window_view(np.pad(marked, 1), (3, 3)).any(axis=(2, 3))
    return marked


def central(height: Any) -> Any:
    """(2, nx, ny): half differences of the neighbours along x and y; beyond the border the map continues."""
    around = np.pad(height, 1, mode="edge")
    return np.stack([around[2:, 1:-1] - around[:-2, 1:-1], around[1:-1, 2:] - around[1:-1, :-2]]) / 2.0


def sampling(shape: Any, x: Any, y: Any) -> Any:
    """(readings, cells): interpolation by straight lines at (x, y); beyond the border the map continues."""
    hats = [
        np.maximum(0.0, 1.0 - np.abs(np.clip(at, 0.0, count - 1.0).reshape(-1, 1) - np.arange(count)))
        for at, count in zip((x, y), shape, strict=True)
    ]
    return np.einsum("ri,rj->rij", *hats).reshape(np.size(x), -1)


def spot_weights(spread: float) -> Any:
    """Weights of a spot of a variance [cells^2] along a line, with a sum of 1."""
    away = np.arange(-c.TAPS, c.TAPS + 1)
    if spread < c.POINT:
        return np.where(away == 0, 1.0, 0.0)
    weights = (
        np.exp(-0.5 * away**2 / spread)
        if spread >= c.NARROW
        else np.interp(np.abs(away), [0, 1, 2], [1 - spread, spread / 2, 0])
    )
    return weights / weights.sum()


def blurred(height: Any, spread: float) -> Any:
    """Averaged over a spot."""
    if spread < c.POINT:
        return height
    for axis in (0, 1):
        wide = np.pad(height, [(c.TAPS, c.TAPS) if axis == k else (0, 0) for k in (0, 1)], mode="edge")
        height = np.apply_along_axis(np.convolve, axis, wide, spot_weights(spread), "valid")
    return height


def misfit(squares: Any) -> float:
    """Median of squares, in that of a normal variable of variance 1; few tell nothing."""
    return float(np.median(squares)) / c.MEDIAN_SQUARE if len(squares) >= c.LEAST_CELLS else 1.0


def scatter(squares: Any) -> float:
    """Mean of the squares within three standard deviations by their median, likewise."""
    return variance_within(squares) if len(squares) >= c.LEAST_CELLS else 1.0


def variance_within(squares: Any) -> float:
    """Variance of a normal variable by its squares within three standard deviations by their median."""
    rough = max(float(np.median(squares)) / c.MEDIAN_SQUARE, c.NOISELESS)
    return float(np.mean(squares[squares <= 9.0 * rough])) / c.MEAN_WITHIN


def upper_misfit(squares: Any) -> float:
    """Half of the same of the upper quartile."""
    few = len(squares) < c.LEAST_CELLS
    return 1.0 if few else 0.5 * float(np.sort(squares)[3 * len(squares) // 4]) / c.QUARTILE_SQUARE


class Setup:
    """`noise`: of a reading [m^2], None where it is learnt; `model`: "scale", "full" or "off"; least, most: volume;

    steps: variance of the rounding of a reading [m^2].
    """

    def __init__(
        self, job: Job, noise: float | None = None, model: str = "scale", *, registered: bool = True, flat: bool = True,
        least: float = 0.5, most: float = 1.25, unseen_layers: int = 5, steps: float = 0.0, drop_levels: int = 1,
    ) -> None:  # fmt: skip
        self.job, self.part, self.shape, self.passes = job, job.mask, job.mask.shape, job.passes
        self.noise, self.model, self.registered, self.flat = noise, model, registered, flat
        self.least, self.most, self.unseen_layers = least, most, unseen_layers
        self.steps, self.drop_levels = steps, drop_levels
        self.nominal = np.array([(ink.h1, ink.h2, ink.h3) for ink in job.inks])
        self.layer = float(np.max(self.nominal @ [1.0, 4.0, 4.0]))
        self.orders = 3 if model == "full" else 1
        self.i, self.j = np.indices(self.shape)
        self.half = np.maximum((np.array(self.shape) - 1.0) / 2.0, 0.5)
        self.u, self.w = self.i / self.half[0] - 1.0, self.j / self.half[1] - 1.0
        self.terms = np.stack([np.ones(self.shape), self.u, self.w, self.u**2, self.u * self.w, self.w**2])
        self.free = ~near(self.part, 3)
        if self.free.sum() < c.LEAST_GROUND:
            self.free = ~near(self.part)

    def no_geometry(self) -> tuple[Any, Any]:
        """(g, covariance) before any scan: shifts, rotation, magnification, shear, spot."""
        turned, grown = c.ROTATION_STD * np.array([0, 1, -1, 0]), c.MAGNIFICATION_STD * np.array([1, 0, 0, 1])
        linear = np.outer(turned, turned) + np.outer(grown, grown) + c.SHEAR_STD**2 * np.eye(4)
        covariance = np.diag([c.SHIFT_STD**2] * 2 + [0.0] * 4 + [c.SPREAD_STD**2])
        covariance[2:6, 2:6] = linear * np.outer(np.tile(self.half, 2), np.tile(self.half, 2))
        return np.zeros(7), covariance

    def inks(self, share: Any) -> Any:
        """(inks, 3) [m] by shares."""
        return self.nominal * np.reshape(share, (len(self.nominal), self.orders))

    def volume(self, share: Any) -> float:
        full = np.array([1.0, 4.0, 4.0])
        return float(np.sum(self.inks(share) @ full) / np.sum(self.nominal @ full))

    def printed(self, height: Any, pattern: Any, inks: Any, factor: Any) -> Any:
        return lu_numpy.layer(height, pattern, (tuple(inks[0]), tuple(inks[-1])), factor, self.passes)[0]

    def increments(self, height: Any, pattern: Any, inks: Any, factor: Any) -> tuple[Any, Any, Any]:
        """(adds of the shares, sum of the squares of what each droplet adds, what a cell's own droplet leaves)."""
        rates, squares = np.zeros((len(inks), 3, *np.add(self.shape, 2))), np.zeros(np.add(self.shape, 2))
        own, inner = np.zeros(self.shape), np.s_[1:-1, 1:-1]
        for colour in lu_numpy.ORDERS[1] if self.passes == 4 else [None]:
            jetted = (pattern > 0) & (True if colour is None else (self.i % 2 == colour[0]) & (self.j % 2 == colour[1]))
            now, beyond = np.where(jetted, pattern, 0), np.pad(height, 1, constant_values=-np.inf)
            heights = np.moveaxis(np.vstack([np.zeros(3), inks])[now], -1, 0) * factor
            left = heights[0].copy()
            for di, dj in np.argwhere(np.ones((3, 3))) - 1:
                order = abs(di) + abs(dj)
                there = np.s_[1 + di : 1 + di + self.shape[0], 1 + dj : 1 + dj + self.shape[1]]
                width = np.where(jetted, heights[0] + heights[order], 1.0)
                taken = np.clip(1.0 + (height - beyond[there]) / width, 0.0, 1.0) if order else 0.0
                for k in range(len(inks)):
                    rates[k, order][there] += np.where(now == k + 1, factor * taken, 0.0)
                    rates[k, order][inner] += np.where(now == k + 1, factor * (1.0 - taken), 0.0)
                if order:
                    squares[there] += (heights[order] * taken) ** 2
                    left += heights[order] * (1.0 - taken)
            squares[inner] += left**2
            own += left
            height = lu_numpy.one_pass(height, now, (tuple(inks[0]), tuple(inks[-1])), factor)[0]
        adds = np.einsum("ko,koij->koij", self.nominal, rates[..., 1:-1, 1:-1])
        return (adds if self.model == "full" else adds.sum(axis=1)).reshape(-1, *self.shape), squares[inner], own

    def places(self, g: Any) -> tuple[Any, Any]:
        return self.i + g[0] + g[2] * self.u + g[3] * self.w, self.j + g[1] + g[4] * self.u + g[5] * self.w
