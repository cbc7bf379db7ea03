"""The observer of controller/core/observer, stated in NumPy with dense matrices, for small grids.

Heights in metres, geometry in cells. S_g is a matrix (readings, cells); an unknown vector is (geometry, datum, shares).
Grids of at most 1024 cells: the core looks at even distances of larger grounds. Nothing is singular here.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inkloop.component import Job
from support.numpy import lu_numpy

DROPLET_STD, DEAD, NOISELESS = 0.1, 15.0, 1e-20  # of a volume [1]; evidence; variance [m^2]
NU, MEDIAN_SQUARE, MAD = 4.0, 0.4549, 1.4826  # t distribution; of normal variables
SHARE_STD, SHARE_STEP, SHARE_RANGE = {"scale": 0.15, "full": 0.3}, {"scale": 0.01, "full": 0.02}, (0.3, 2.0)
DATUM_STD, DATUM_KEPT, LEAST_SPREAD, SURELY = np.array([1.3, 0.8, 0.8, 0.4, 0.4, 0.4]), 0.8, 1e-17, 1e-30
NOISE_KEPT, KNOWN_GROUND, GROUND_TOLERANCE, LEAST_SEEN = 0.7, 1e-18, 3.0, 0.02
FOREIGN, USUAL, STEEP, LEAST_CELLS, LEAST_DROPLETS, LEAST_GROUND = 4.0, 2.0, 0.8, 12, 20, 20
SHIFT_STD, SPREAD_STD, ROTATION_STD, MAGNIFICATION_STD, SHEAR_STD = 1.0, 0.5, 0.03, 0.02, 0.004
FIRST_STEP, LINEAR_STEP, SPREAD_STEP, LEAST_STEP, STEP_GAIN = 0.1, 5e-4, 0.01, 0.01, 0.3
FIRST_ODDS, TEMPER, PRICE, ODDS_RANGE, DECIDED = -3.0, 0.5, 0.7, (-6.0, 40.0), 3.0
WALL, SLOPE_STEP, SPOT_STEP, SAME_SPREAD, NARROW, TAPS, READING = 0.1, 0.3, 0.1, 0.1, 0.36, 5, 0.004
ROUNDS, COLD, LONGEST_MOVE, LARGEST_SPREAD, UNKNOWN_SHIFT, TRIED = 7, 2, 0.7, 4.0, 0.3, 3
SURPRISE, CERTAIN, SAME, SPIKY, LEAST_VARIANCE, LEAST_ERROR = 4.5, 0.9, 0.4, 0.008, 1e-21, 1e-24
WEAK, LAYER_EVIDENCE, WHOLE_HEAD, NOT_SEEN, NO_VOLUME, UNSURE = 0.3, 5.0, 0.5, 1e-6, 1e-12, 1e-6
KEPT, LEAST_VARIATION, LARGEST_FOUND, LARGEST_VARIATION = 0.8, 0.01, 9.0, 2.0
FIRST_EVIDENCE, EVIDENCE_MAX, OF_A_MEDIAN, EARLY = 10.0, 500.0, 0.37, 12
SUSPICIOUS, OUTLIER, FAR_BETTER, DOUBT_KEPT, BELIEVED, LEAST_SHARE, SMOOTH = 4.0, 100.0, 0.4, 0.5, 1.4, 0.05, 2e-4
LEAST_EVEN, NOISY, VOLUME_STD, RESERVE, HIGH = 40, 1e-16, 0.05, 1.0, 0.4
UNIFORM_MEDIAN_SQUARE, MODEL_MAX, DEVIATION_MAX, OTHER_DROPLETS, SPILL_MAX = 0.75, 0.3, 0.15, 5.0, 6.0
NO_GROWTH, SAME_SCAN, LATE, TURNED, VOLUME = 64, 128, 256, 512, 1024
TURNS = (
    lambda m: m[::-1], lambda m: m[:, ::-1], lambda m: m[::-1, ::-1], lambda m: m.T, lambda m: np.rot90(m, 1),
    lambda m: np.rot90(m, 3), lambda m: np.rot90(m, 2).T,
)  # fmt: skip
"""What the scan would be if it were mirrored or turned; the last four on square grids."""
SPREAD, SHIFTS, TERMS = 6, 2, np.s_[7:13]  # of the unknowns: variance of the spot; shifts; terms of the datum


@dataclass
class State:
    """What is known after a scan, as in surface_estimate.h; surprised: scans in a row."""

    height: Any
    variance: Any
    ledger: Any
    last: Any
    last_valid: Any
    unseen: Any
    share: Any
    share_covariance: Any
    datum_spread: Any
    noise: float
    g: Any
    covariance: Any
    surprise: Any = 0.0
    surprised: Any = 0
    dead: Any = 0.0
    capped: Any = None
    high: Any = None
    ground: Any = field(default_factory=lambda: np.zeros(3))
    ground_wrong: bool = False
    variation: float = 1.0
    evidence: float = FIRST_EVIDENCE
    vanishing: float = 0.0
    scans: int = 1
    steps: Any = field(default_factory=lambda: np.full(2, FIRST_STEP**2))
    odds: float = FIRST_ODDS
    misfits: list[float] = field(default_factory=list)
    is_displaced: bool = False
    layers: int = 0
    early: float = 1.0
    residual: float = 1.0
    mean_misfit: Any = field(default_factory=lambda: np.ones(2))
    doubts: Any = field(default_factory=lambda: np.zeros(9))
    volume_doubt: float = 0.0
    stop: tuple[int, int, int, float] = (0, 0, 0, 0.0)  # reason, layer, transform, figure
    is_looked_at: bool = False


@dataclass
class Fit:
    """Shares, the datum left, and what they leave: misfit of cells with a droplet and of their neighbours."""

    share: Any
    share_covariance: Any
    datum: Any
    datum_covariance: Any
    misfit: Any
    droplets: int = 0
    base: float = 0.0
    squares: float = 0.0


@dataclass
class Look:
    """A scan with all that is known before it; adds: (shares, nx, ny), what a change of each share by 1 adds [m]."""

    state: State
    pattern: Any
    scan: Any
    valid: Any
    predicted: Any
    variance: Any
    adds: Any
    squares: Any
    own: Any
    full_own: Any
    noise: float
    datum: tuple[Any, Any, Any, float | None]
    is_unknown: bool

    def __post_init__(self) -> None:
        self.of_droplet = DROPLET_STD**2 * self.state.variation
        self.native = self.noise + self.variance + self.of_droplet * self.squares
        self.reached = self.valid & (self.squares > 0.0)
        self.classes = np.where(self.pattern > 0, 0, np.where(self.squares > 0.0, 1, 2))

    def change(self, share: Any) -> Any:
        """(nx, ny): what other shares than those known add."""
        return np.tensordot(share - self.state.share, self.adds, 1)

    def rest(self, fit: Fit, terms: Any) -> Any:
        """(nx, ny): what a fit in register leaves of the scan."""
        return self.scan - self.predicted - self.change(fit.share) - np.tensordot(fit.datum, terms, 1)


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


def blurred(height: Any, spread: float) -> Any:
    """Averaged over a spot of a variance [cells^2]."""
    if spread < 1e-9:
        return height
    away = np.arange(-TAPS, TAPS + 1)
    weights = (
        np.exp(-0.5 * away**2 / spread)
        if spread >= NARROW
        else np.interp(np.abs(away), [0, 1, 2], [1 - spread, spread / 2, 0])
    )
    for axis in (0, 1):
        wide = np.pad(height, [(TAPS, TAPS) if axis == k else (0, 0) for k in (0, 1)], mode="edge")
        height = np.apply_along_axis(np.convolve, axis, wide, weights / weights.sum(), "valid")
    return height


def misfit(squares: Any) -> float:
    """Median of squares, in that of a normal variable of variance 1; few tell nothing."""
    return float(np.median(squares)) / MEDIAN_SQUARE if len(squares) >= LEAST_CELLS else 1.0


class Observer:
    """`noise`: of a reading [m^2], None where it is learnt; `model`: "scale", "full" or "off"; least, most: volume."""

    def __init__(
        self, job: Job, noise: float | None = None, model: str = "scale", *, registered: bool = True, flat: bool = True,
        least: float = 0.5, most: float = 1.25, unseen_layers: int = 5,
    ) -> None:  # fmt: skip
        self.job, self.part, self.shape, self.passes = job, job.mask, job.mask.shape, job.passes
        self.noise, self.model, self.registered, self.flat = noise, model, registered, flat
        self.least, self.most, self.unseen_layers = least, most, unseen_layers
        self.nominal = np.array([(ink.h1, ink.h2, ink.h3) for ink in job.inks])
        self.layer = float(np.max(self.nominal @ [1.0, 4.0, 4.0]))
        self.orders = 3 if model == "full" else 1
        self.i, self.j = np.indices(self.shape)
        self.half = np.maximum((np.array(self.shape) - 1.0) / 2.0, 0.5)
        self.u, self.w = self.i / self.half[0] - 1.0, self.j / self.half[1] - 1.0
        self.terms = np.stack([np.ones(self.shape), self.u, self.w, self.u**2, self.u * self.w, self.w**2])
        self.free = ~near(self.part, 3)

    def no_geometry(self) -> tuple[Any, Any]:
        """(g, covariance) before any scan: shifts, rotation, magnification, shear, spot."""
        turned, grown = (
            ROTATION_STD * np.array([0.0, 1.0, -1.0, 0.0]),
            MAGNIFICATION_STD * np.array([1.0, 0.0, 0.0, 1.0]),
        )
        linear = np.outer(turned, turned) + np.outer(grown, grown) + SHEAR_STD**2 * np.eye(4)
        covariance = np.diag([SHIFT_STD**2] * 2 + [0.0] * 4 + [SPREAD_STD**2])
        covariance[2:6, 2:6] = linear * np.outer(np.tile(self.half, 2), np.tile(self.half, 2))
        return np.zeros(7), covariance

    def inks(self, share: Any) -> Any:
        """(inks, 3) [m] by shares."""
        return self.nominal * np.reshape(share, (len(self.nominal), self.orders))

    def volume(self, share: Any) -> float:
        full = np.array([1.0, 4.0, 4.0])
        return float(np.sum(self.inks(share) @ full) / np.sum(self.nominal @ full))

    # 1. prediction

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

    # 2. datum and noise

    def datum(self, scan: Any, known: Any, cells: Any, spread: Any, noise: float) -> tuple[Any, Any, Any, float | None]:
        """(terms, covariance, precision, variance of readings about it) of a robust fit on cells that show it."""
        A, rise, variance = self.terms[:, cells].T, (scan - known)[cells], max(noise, NOISELESS)
        if len(A) < LEAST_GROUND:
            return np.zeros(6), np.zeros((6, 6)), np.eye(6) / SURELY, None
        weight = np.ones(len(A))
        for _ in range(6):
            N = (A.T * weight / variance) @ A + np.diag(1.0 / spread)
            term = solved(N, A.T @ (weight * rise) / variance)
            rest = rise - A @ term
            scale = max((MAD * float(np.median(np.abs(rest)))) ** 2, NOISELESS)
            variance = max((variance + scale) / 2.0, NOISELESS)
            weight = (NU + 1.0) / (NU + rest**2 / scale)
        return term, inverse(N), N, scale

    def reading_noise(self, s: State, shown: float | None) -> float:
        least = NOISELESS
        if self.noise is not None or shown is None:
            return max(s.noise, least)
        if s.scans == 1:
            return max(shown if self.flat else shown / 2.0, least)
        return max(NOISE_KEPT * s.noise + (1.0 - NOISE_KEPT) * shown, least)

    # 3. the whole scan

    def cost(self, s: State, scan: Any, valid: Any, expected: Any, even: Any, noise: float, most: float) -> float:
        """Robust mean square of what a scan leaves on even cells, its datum fitted; infinite: too few cells."""
        cells = self.free if np.sum(self.free & valid) >= LEAST_GROUND else even
        term = self.datum(scan, expected, cells & valid, s.datum_spread, max(noise, SMOOTH * self.layer**2))[0]
        left = (scan - expected - np.tensordot(term, self.terms, 1))[valid & even]
        return float(np.mean(np.minimum(left**2, most))) if len(left) >= LEAST_EVEN else np.inf

    def is_doubted(self, s: State, before: State, look: Look, scan: Any, layer: int) -> bool:
        """Whether another explanation of the whole scan fits far better; `s` collects the evidence."""
        s.doubts = DOUBT_KEPT * s.doubts
        jetted, valid = look.pattern > 0, look.valid
        if not jetted.any():
            return False
        noise = look.noise if s.scans == 1 and not self.flat else s.noise
        share = jetted.sum() / max(self.part.sum(), 1)
        growth = np.mean((look.predicted - before.height)[jetted] ** 2)
        native = noise + look.of_droplet * np.mean(look.own[jetted] ** 2) * max(share, LEAST_SHARE)
        native += np.mean(np.diag(s.share_covariance)) * growth * share
        even = np.sum(central(look.predicted) ** 2, axis=0) < (STEEP * self.layer) ** 2

        def cost(scan: Any, valid: Any, expected: Any) -> float:
            return self.cost(before, scan, valid, expected, even, noise, OUTLIER * native)

        expected, past = (self.read(s, height) for height in (look.predicted, before.height))
        read = cost(scan, valid, expected)
        if not SUSPICIOUS * native < read < np.inf:
            return False
        turns = TURNS if self.shape[0] == self.shape[1] else TURNS[:3]
        costs = [cost(scan, valid, past), cost(scan, valid & before.last_valid, before.last)]
        costs += [cost(turn(scan), turn(valid), expected) for turn in turns]
        best = int(np.argmin(costs))
        if costs[best] >= FAR_BETTER * read:
            return False
        s.doubts[best] += 1.0
        is_stuck = best < 2
        if s.stop[0] == 0 and (s.doubts[:2].sum() if is_stuck else s.doubts[best]) >= BELIEVED:
            both = valid & before.last_valid
            is_last = noise > NOISY and np.array_equal(scan[both], before.last[both])
            stuck = LATE if costs[1] >= FAR_BETTER * read else SAME_SCAN if is_last else NO_GROWTH
            figure = float(np.sqrt(read / max(costs[best], noise)))
            s.stop = (stuck if is_stuck else TURNED, layer, 0 if is_stuck else best, figure)
        return True

    def places(self, g: Any) -> tuple[Any, Any]:
        return self.i + g[0] + g[2] * self.u + g[3] * self.w, self.j + g[1] + g[4] * self.u + g[5] * self.w

    def read(self, s: State, height: Any) -> Any:
        """What the sensor reads of a surface by what is believed of it."""
        if not s.is_displaced:
            return height
        return (sampling(self.shape, *self.places(s.g)) @ blurred(height, s.g[SPREAD]).ravel()).reshape(self.shape)

    # 4. the fits

    def smooth_prior(self, look: Look) -> Any:
        """Precision of datum and shares before the scan."""
        shares = 0 if self.model == "off" else len(look.state.share)
        precision = np.zeros((6 + shares, 6 + shares))
        precision[:6, :6] = look.datum[2]
        if shares:
            step = SHARE_STEP[self.model] ** 2 * np.eye(shares)
            precision[6:, 6:] = inverse(look.state.share_covariance + step)
        return precision

    def smooth_sums(self, look: Look, cells: Any, is_robust: bool) -> tuple[Any, Any]:
        """Normal equations (matrix, side) of datum and changes of the shares by cells in register."""
        columns = self.terms if self.model == "off" else np.concatenate([self.terms, look.adds])
        A, rest, native = columns[:, cells].T, (look.scan - look.predicted)[cells], look.native[cells]
        weight = (NU + 1.0) / (NU * native + rest**2) if is_robust else 1.0 / native
        return (A.T * weight) @ A, A.T @ (weight * rest)

    def fitted(self, look: Look, x: Any, covariance: Any) -> Fit:
        """What was found of datum and shares (not their changes)."""
        if self.model == "off":
            return Fit(look.state.share, look.state.share_covariance, x[:6], covariance[:6, :6], np.ones(2))
        return Fit(np.clip(x[6:], *SHARE_RANGE), covariance[6:, 6:], x[:6], covariance[:6, :6], np.ones(2))

    def in_register(self, look: Look) -> Fit:
        """Robust, or by least squares where droplets are foreign."""
        for is_robust in (True, False):
            matrix, side = self.smooth_sums(look, look.reached, is_robust)
            matrix = matrix + self.smooth_prior(look)
            x = solved(matrix, side)
            x[6:] += look.state.share[: len(x) - 6]
            fit = self.fitted(look, x, inverse(matrix))
            squares, own = look.rest(fit, self.terms) ** 2 / look.native, look.reached & (look.pattern > 0)
            fit.misfit = np.array([misfit(squares[own]), misfit(squares[look.reached & ~own])])
            fit.droplets = int(own.sum())
            if own.any():
                fit.base, fit.squares = np.mean((look.noise + look.variance)[own]), np.mean(look.squares[own])
            if fit.misfit.max() < FOREIGN:
                break
        return fit

    def walls(self, s: State, look: Look, prior: Any) -> Any:
        """Cells that the geometry may move."""
        if s.is_displaced:
            return np.ones(self.shape, np.bool_)
        spread = max(prior[0, 0] + prior[2, 2] + prior[3, 3], prior[1, 1] + prior[4, 4] + prior[5, 5])
        least = WALL * (look.noise + look.of_droplet * self.nominal[0, 0] ** 2) / spread
        steep = np.sum(central(look.predicted) ** 2, axis=0) > least
        return near(steep, 3 if spread > 0.25 else 2 if spread > 0.06 else 1)

    def displaced(self, s: State, look: Look, in_register: Fit) -> tuple[Fit, Any, Any]:
        """(fit of the scan as displaced, walls, slope with the spot); `s` learns the geometry."""
        step = np.concatenate([np.sqrt(s.steps), LINEAR_STEP * np.tile(self.half, 2), [SPREAD_STEP]])
        prior = s.covariance + np.diag(step**2)
        walls, fit = self.walls(s, look, prior), deepcopy(in_register)
        fit.droplets = 0
        at = [np.clip(place, 0.0, count - 1.0) for place, count in zip(self.places(s.g), self.shape, strict=True)]
        cells = look.valid & walls[tuple(np.ceil(place - 0.5).astype(int) for place in at)]
        view = View(self, look, cells, s.g[SPREAD])
        if cells.sum() < LEAST_CELLS:
            return fit, walls, view.with_spot
        before = np.concatenate([s.g, np.zeros(6), [] if self.model == "off" else s.share])
        precision = np.zeros((len(before), len(before)))
        precision[:7, :7], precision[7:, 7:] = inverse(prior), self.smooth_prior(look)
        others = self.smooth_sums(look, look.reached & ~walls, in_register.misfit.max() < FOREIGN)

        def equations(x: Any, heat: float) -> tuple[Any, Any]:
            weight = (NU + 1.0) / (NU * heat * view.variance + view.rest**2)
            matrix = precision + (view.J.T * weight) @ view.J
            matrix[7:, 7:] += others[0]
            side = precision @ (before - x) + view.J.T @ (weight * view.rest)
            side[7:] += others[1] - others[0] @ (x - before)[7:]
            return matrix, side

        def cost(x: Any) -> float:
            view.look(x)
            prior_cost = np.sum((x - before)[:2] ** 2 / np.diag(prior)[:2]) / 2.0
            return float((NU + 1.0) / 2.0 * np.sum(np.log1p(view.rest**2 / (NU * view.variance))) + prior_cost)

        x, shift_variance = before.copy(), max(prior[0, 0], prior[1, 1])
        for times, distance in ((TRIED, 1.0), (1, 0.5)) if shift_variance >= UNKNOWN_SHIFT**2 else ():
            tried = [x] + [
                np.concatenate([x[:2] + distance * np.array(by), x[2:]])
                for by in np.argwhere(np.ones((2 * times + 1, 2 * times + 1))) - times
            ]
            x = tried[int(np.argmin([cost(each) for each in tried]))]
        for number in range(ROUNDS):
            if abs(x[SPREAD] - view.spread) > SAME_SPREAD:
                view.average(x[SPREAD])
            view.look(x)
            hot = view.slopes * shift_variance > 4.0 * view.variance
            is_hot = number + COLD < ROUNDS and hot.sum() > LEAST_CELLS // 2
            heat = float(np.median((view.rest**2 / view.variance)[hot])) / MEDIAN_SQUARE if is_hot else 1.0
            last, x = x, x + solved(*equations(x, max(heat, 1.0)))
            x[:7] = np.clip(x[:7], last[:7] - LONGEST_MOVE, last[:7] + LONGEST_MOVE)
            x[SPREAD], x[13:] = np.clip(x[SPREAD], 0.0, LARGEST_SPREAD), np.clip(x[13:], *SHARE_RANGE)
        view.look(x)
        covariance = inverse(equations(x, 1.0)[0])
        fit, squares = self.fitted(look, x[7:], covariance[7:, 7:]), view.rest**2 / view.variance
        fit.misfit = np.array([misfit(squares[view.classes == k]) for k in (0, 1)])
        steep = misfit(squares[view.slopes > (STEEP * self.layer) ** 2])
        fit.droplets = int(np.sum(view.classes == 0))
        if fit.droplets:
            fit.squares = np.mean(view.squares[view.classes == 0])
            fit.base = np.mean(view.variance[view.classes == 0]) - look.of_droplet * fit.squares
        variance = NU * np.minimum(view.variance, look.native[cells])
        plain = look.rest(in_register, self.terms)[cells]
        gained = (NU + 1.0) / 2.0 * np.sum(np.log1p(plain**2 / variance) - np.log1p(view.rest**2 / variance))
        self.learn_geometry(s, x, covariance, max(1.0, steep, *fit.misfit), gained)
        return fit, walls, view.with_spot

    def may_be_displaced(self, s: State) -> bool:
        return float(np.median(s.misfits)) < FOREIGN

    def learn_geometry(self, s: State, x: Any, covariance: Any, left: float, gained: float) -> None:
        s.misfits = [*s.misfits, left][-3:]
        s.odds = float(np.clip(s.odds + TEMPER * gained - PRICE, *ODDS_RANGE))
        may_be = self.may_be_displaced(s)
        if len(s.misfits) > 1 and may_be:
            steps = (1.0 - STEP_GAIN) * s.steps + STEP_GAIN * (x - np.pad(s.g, (0, len(x) - 7)))[:2] ** 2
            s.steps = np.maximum(steps, LEAST_STEP**2)
        s.is_displaced = s.odds > DECIDED and may_be
        is_kept = left < FOREIGN or s.is_displaced
        s.g, s.covariance = (x[:7].copy(), covariance[:7, :7].copy()) if is_kept else self.no_geometry()

    # 5. the maps

    def take_scan(self, s: State, before: State, look: Look) -> None:
        is_registered, walls, with_spot = self.registered and not look.is_unknown, None, None
        in_register = fit = displaced = self.in_register(look)
        if is_registered:
            displaced, walls, with_spot = self.displaced(s, look, in_register)
            fit = displaced if s.is_displaced else in_register
        may_be = is_registered and bool(s.misfits) and self.may_be_displaced(s)
        is_robust = may_be or fit.misfit.max() < FOREIGN
        extra = np.append(np.maximum(fit.misfit - USUAL, 0.0) * (not may_be and not s.is_displaced), 0.0)
        known = np.maximum(
            look.variance + look.of_droplet * look.squares + extra[look.classes] * look.native, LEAST_VARIANCE
        )
        left = np.tensordot(fit.datum, self.terms, 1)
        of_datum = np.maximum(np.einsum("aij,ab,bij->ij", self.terms, fit.datum_covariance, self.terms), 0.0)
        change = look.change(fit.share)
        if s.is_displaced:
            view = View(self, look, np.ones(self.shape, np.bool_), s.g[SPREAD])
            view.look(np.concatenate([s.g, np.zeros(6), [] if self.model == "off" else s.share]))
            S = view.S
            rest = look.scan - left - (view.averaged.ravel() @ S.T + change.ravel() @ S.T).reshape(self.shape)
            of_geometry = (
                np.einsum("ra,ab,rb->r", view.J[:, :7], s.covariance, view.J[:, :7]) + READING**2 * view.slopes
            )
            spread, error = (
                (S @ known.ravel()).reshape(self.shape),
                look.noise + of_datum + of_geometry.reshape(self.shape),
            )
        else:
            rest, spread, error = look.scan - left - look.predicted - change, known, look.noise + of_datum
            if may_be:
                x, y = central(look.predicted)
                J = np.stack([x, y, x * self.u, x * self.w, y * self.u, y * self.w, with_spot])
                doubtful = s.covariance + np.outer(s.g, s.g)
                error = error + np.where(walls, np.einsum("aij,ab,bij->ij", J, doubtful, J), 0.0)
        weight, jump, vanished = self.believed(s, before, look, rest, spread + error, is_robust)
        weak = np.maximum((spread + error) / np.maximum(weight, 1e-9) - spread, LEAST_ERROR)
        weight = np.where(look.valid, 1.0 / weak, 0.0)
        known = known + jump
        if s.is_displaced:
            back = sampling(self.shape, *self.back(s.g))
            seen = (back @ weight.ravel()).reshape(self.shape)
            is_seen = seen * known > NOT_SEEN
            rest = np.where(
                is_seen, (back @ (weight * rest).ravel()).reshape(self.shape) / np.where(is_seen, seen, 1.0), 0.0
            )
            weight = np.where(is_seen, seen, 0.0)
            variance = known + 1.0 / np.where(is_seen, seen, np.inf)
        else:
            is_seen, rest, variance = look.valid, np.where(look.valid, rest, 0.0), spread + error
        s.unseen = np.where(is_seen, 0, before.unseen + 1)
        s.height = look.predicted + change + known * weight / (1.0 + known * weight) * rest
        s.variance = known / (1.0 + known * weight)
        if look.is_unknown:
            return
        s.dead = self.dead(before, look, is_seen, rest, variance)
        s.vanishing = 0.9 * s.vanishing + 0.1 * vanished / max(look.valid.sum(), 1)
        is_better = may_be and displaced.droplets >= LEAST_DROPLETS and displaced.misfit[0] < in_register.misfit[0]
        self.learn(s, look, displaced if s.is_displaced or is_better else in_register, fit)

    def back(self, g: Any) -> tuple[Any, Any]:
        """Where on the scan the reading of each cell lies."""
        linear = np.eye(2) + g[2:6].reshape(2, 2) / self.half
        inner = np.stack([self.i - self.half[0] - g[0], self.j - self.half[1] - g[1]])
        x, y = np.tensordot(np.linalg.inv(linear), inner, 1)
        return x + self.half[0], y + self.half[1]

    def believed(
        self, s: State, before: State, look: Look, rest: Any, variance: Any, is_robust: bool
    ) -> tuple[Any, Any, int]:
        """(weights of the readings, variances by which cells have jumped, surprises that have vanished)."""
        square, told = rest**2 / variance, before.surprise
        weight = 1.0 / (1.0 + np.exp(np.minimum((square - SURPRISE**2) / 2.0, 60.0)))
        weight = np.where((square > SURPRISE**2 / 2.0) & is_robust, weight, 1.0)
        is_big = weight < CERTAIN
        is_same = is_big & (told * rest > 0.0) & (np.abs(told) > SAME * np.abs(rest))
        times = np.where(is_same, before.surprised + 1, is_big)
        is_real = look.valid & is_same & (times >= (3 if before.vanishing > SPIKY else 2))
        s.surprise = np.where(look.valid & is_big & ~is_real, rest, 0.0)
        s.surprised = np.where(look.valid & ~is_real, times, 0)
        vanished = int(np.sum(look.valid & (told != 0.0) & ~is_big))
        return np.where(is_real, 1.0, weight), np.where(is_real, rest**2, 0.0), vanished

    def dead(self, before: State, look: Look, is_seen: Any, rest: Any, variance: Any) -> Any:
        """Evidence that nothing comes, against a weak droplet."""
        grown = rest + np.where(before.dead < DEAD, look.own, 0.0)
        weak, least = WEAK * look.full_own, np.maximum(np.minimum(variance, look.full_own**2), LEAST_VARIANCE)
        evidence = np.where(is_seen & (look.full_own > 0.0), weak * (weak / 2.0 - grown) / least, 0.0)
        if np.sum(evidence > 0.0) > WHOLE_HEAD * self.part.sum():
            return before.dead
        return np.clip(before.dead + np.clip(evidence, -LAYER_EVIDENCE, LAYER_EVIDENCE), 0.0, DEAD)

    def learn(self, s: State, look: Look, fit: Fit, believed: Fit) -> None:
        """Variance of droplets, spread of the datum, shares."""
        own = DROPLET_STD**2 * fit.squares
        if fit.droplets >= LEAST_DROPLETS and own > 0.0:
            found = max(LEAST_VARIATION, s.variation + (fit.misfit[0] - 1.0) * (fit.base + s.variation * own) / own)
            share = max(found, s.variation) * own / (fit.base + max(found, s.variation) * own)
            kept, freedom = KEPT * s.evidence, OF_A_MEDIAN * fit.droplets * share**2
            mean = (kept * s.variation + freedom * min(found, LARGEST_FOUND)) / (kept + freedom)
            s.variation, s.evidence = min(mean, LARGEST_VARIATION), min(kept + freedom, EVIDENCE_MAX)
            s.layers += 1
            s.residual = KEPT * s.residual + (1.0 - KEPT) * found
            s.mean_misfit = KEPT * s.mean_misfit + (1.0 - KEPT) * fit.misfit
            if s.layers <= EARLY:
                s.early += (found - s.early) / s.layers
        if look.datum[3] is not None:
            square = np.maximum((look.datum[0] + believed.datum) ** 2, LEAST_SPREAD)
            s.datum_spread = DATUM_KEPT * s.datum_spread + (1.0 - DATUM_KEPT) * square
        s.share, s.share_covariance = believed.share, believed.share_covariance

    # 6. ledger, volume, and the steps

    def look_at_part(self, s: State, layer: int | None) -> None:
        """Volume beyond belief, where a layer was scanned; cells that are capped, and that stand too high."""
        volume = self.volume(s.share)
        if layer is not None:
            s.volume_doubt *= DOUBT_KEPT
            is_known = self.model == "scale" and np.mean(np.diag(s.share_covariance)) < VOLUME_STD**2
            s.volume_doubt += is_known and not self.least <= volume <= self.most
            if is_known and not self.least <= volume <= self.most and s.stop[0] == 0 and s.volume_doubt >= BELIEVED:
                s.stop = (VOLUME, layer, 0, volume)
        target = self.job.target_height
        s.capped = self.part & (self.least * s.ledger > target + RESERVE * self.layer)
        s.high = self.part & (s.height - np.maximum(target, volume * s.ledger) > HIGH * self.layer)

    def first(self, scan: Any, valid: Any) -> State:
        """Of layer 0."""
        noise, shares, scan = self.noise or 0.0, self.orders * len(self.nominal), np.where(valid, scan, 0.0)
        variance = (SHARE_STD.get(self.model, 0.0) ** 2) * np.eye(shares)
        first_variance = float(np.mean(self.nominal @ [1.0, 4.0, 4.0])) ** 2
        zero, spread = np.zeros(self.shape), (DATUM_STD * self.layer) ** 2
        s = State(
            scan, np.where(valid, noise, first_variance), zero, scan, valid, np.where(valid, 0, 1), np.ones(shares),
            variance, spread, noise, *self.no_geometry(), surprise=zero, surprised=zero.astype(int), dead=zero,
        )  # fmt: skip
        if self.flat:
            term, _, _, shown = self.datum(scan, 0.0 * scan, valid, spread, max(noise, NOISELESS))
            s.noise = max(shown or 0.0, NOISELESS) if self.noise is None else noise
            s.ground, s.ground_wrong = (
                term[:3] * [1.0, 2.0, 2.0],
                np.abs(term[:3]).sum() > GROUND_TOLERANCE * self.layer,
            )
            s.height, s.variance = zero, np.full(self.shape, KNOWN_GROUND)
        s.ledger = s.height
        self.look_at_part(s, None)
        return s

    def next(self, before: State, pattern: Any, layer: int, scan: Any, valid: Any, is_unknown: bool = False) -> State:
        s, scan = deepcopy(before), np.where(valid, scan, 0.0)
        s.last, s.last_valid, inks = scan, valid, self.inks(before.share)
        living = np.where(before.dead >= DEAD, NO_VOLUME, 1.0)
        full_own = np.append(0.0, inks[:, 0])[pattern]
        predicted = self.printed(before.height, pattern, inks, living)
        adds, squares, own = self.increments(before.height, pattern, inks, living)
        ledger, variance = self.printed(before.ledger, pattern, self.nominal, living), before.variance.copy()
        if is_unknown:
            variance += (predicted - before.height) ** 2 / 12.0
            predicted, ledger = (before.height + predicted) / 2.0, (before.ledger + ledger) / 2.0
            adds, squares, own = 0.0 * adds, 0.0 * squares, 0.0 * own
        datum = self.datum(scan, before.height, self.free & valid, s.datum_spread, max(s.noise, NOISELESS))
        noise = self.reading_noise(s, datum[3])
        if s.scans == 1 and self.noise is None:  # what the first scan was worth
            variance += noise * ((before.unseen == 0) & (variance <= noise) & (before.variance != KNOWN_GROUND))
        flat = np.where(valid, scan - np.tensordot(datum[0], self.terms, 1), 0.0)
        look = Look(
            before, pattern, flat, valid, predicted, variance, adds, squares, own, full_own, noise, datum, is_unknown
        )
        is_scan = valid.sum() >= max(LEAST_SEEN * valid.size, 1)
        if not is_scan or (not is_unknown and not s.is_looked_at and self.is_doubted(s, before, look, scan, layer)):
            s.height, s.unseen = predicted, before.unseen + 1
            s.variance = np.maximum(variance + look.of_droplet * squares, LEAST_VARIANCE)
            s.surprise, s.surprised = np.zeros(self.shape), np.zeros(self.shape, int)
        else:
            s.is_looked_at, s.noise = False, s.noise if is_unknown else noise
            self.take_scan(s, before, look)
        s.scans, s.ledger = before.scans + 1, ledger
        self.look_at_part(s, None if is_unknown else layer)
        return s

    def figures(self, s: State) -> dict[str, Any]:
        """What is reported, by the names of `EstimateFigures`."""
        found = DROPLET_STD * float(np.sqrt(s.residual * MEDIAN_SQUARE / UNIFORM_MEDIAN_SQUARE))
        model = DROPLET_STD * float(np.sqrt(s.early))
        std = min(model, MODEL_MAX) if s.early > OTHER_DROPLETS else min(found, DEVIATION_MAX) if s.layers else 0.0
        reason, layer, transform, figure = s.stop
        shown = {
            "volume": self.volume(s.share), "droplet_std": std, "noise_std": np.sqrt(s.noise), "ground": s.ground,
            "surprise": np.sqrt(s.mean_misfit[0]), "stop": reason, "stop_layer": layer, "stop_figure": figure,
            "transform": transform, "dead_cells": np.sum(s.dead >= DEAD), "capped_cells": np.sum(s.capped),
            "unseen_cells": np.sum(s.unseen[self.part] > self.unseen_layers), "scans": s.scans,
            "is_foreign": s.mean_misfit[1] > SPILL_MAX, "is_displaced": s.is_displaced and bool(s.misfits),
        }  # fmt: skip
        if s.misfits:
            spread, error = max(s.g[SPREAD], 0.0), np.sqrt(s.covariance[SPREAD, SPREAD])
            linear = s.g[2:6].reshape(2, 2) / self.half
            shown |= {
                "shift_x": s.g[0], "shift_y": s.g[1], "shift_std": np.sqrt(np.diag(s.covariance)[:2].max()),
                "spot_radius": np.sqrt(spread) if s.is_displaced and spread > 2.0 * error else 0.0,
                "spot_std": np.sqrt(spread + error) - np.sqrt(spread),
                "rotation": (linear[1, 0] - linear[0, 1]) / 2.0, "magnification": np.trace(linear) / 2.0,
            }  # fmt: skip
        return shown


class View:
    """What a displaced sensor reads on some cells, linear in the unknowns about x."""

    def __init__(self, observer: Observer, look: Look, cells: Any, spread: float) -> None:
        self.observer, self.data, self.cells = observer, look, cells
        self.average(spread)

    def average(self, spread: float) -> None:
        self.spread = max(spread, 0.0)
        self.averaged = blurred(self.data.predicted, self.spread)
        self.with_spot = (blurred(self.data.predicted, self.spread + SPOT_STEP) - self.averaged) / SPOT_STEP

    def look(self, x: Any) -> None:
        """Rests, their variances and classes, and the matrix J of what the unknowns change."""
        o, data, cells = self.observer, self.data, self.cells
        at = np.stack(o.places(x[:7]))[:, cells]
        self.S = S = sampling(o.shape, *at)
        slope = [
            (sampling(o.shape, *(at + step)) - sampling(o.shape, *(at - step)))
            @ self.averaged.ravel()
            / (2.0 * SLOPE_STEP)
            for step in SLOPE_STEP * np.eye(2)[:, :, None]
        ]
        u, w, terms = o.u[cells], o.w[cells], o.terms[:, cells]
        geometry = [
            slope[0],
            slope[1],
            slope[0] * u,
            slope[0] * w,
            slope[1] * u,
            slope[1] * w,
            S @ self.with_spot.ravel(),
        ]
        shares = [S @ add.ravel() for add in data.adds[: len(x) - 13]]
        self.J = np.stack([*geometry, *terms, *shares], axis=1)
        change = np.concatenate([[x[SPREAD] - self.spread], x[7:13], x[13:] - data.state.share[: len(x) - 13]])
        self.rest = data.scan[cells] - S @ self.averaged.ravel() - self.J[:, SPREAD:] @ change
        self.slopes, self.squares = slope[0] ** 2 + slope[1] ** 2, S @ data.squares.ravel()
        self.variance = (
            data.noise + S @ data.variance.ravel() + data.of_droplet * self.squares + READING**2 * self.slopes
        )
        is_own = np.any((S > 0.0) & (data.pattern.ravel() > 0), axis=1)
        self.classes = np.where(is_own, 0, np.where(self.squares > 0.0, 1, 2))
