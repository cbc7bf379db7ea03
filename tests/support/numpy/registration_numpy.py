"""The registration of scans stated in NumPy, with whole maps and dense matrices, to check controller/core/estimator.

Six unknowns: the displacement before (shift along x and y [cells], spread of the spot [cells^2]), the step of the
shift since, the growth beyond the predicted one. Inks are known here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.ndimage import convolve1d, map_coordinates
from scipy.optimize import brentq

from inkloop.component import Job
from support.numpy import estimator_numpy
from support.numpy.estimator_numpy import near

READING, WALL, HUBER, STRANGE = 2e-8, 4.0, 3.0, 6.0
NOW = np.eye(3, 6) + np.eye(3, 6, 3) * np.array([[1.0], [1.0], [0.0]])  # the displacement of this scan, by unknowns


def _weights(radius: float) -> Any:
    reach = int(np.clip(np.floor(4.0 * radius), 1, 64))
    return np.exp(-0.5 * (np.arange(-reach, reach + 1) / radius) ** 2)


@cache
def radius(spread: float) -> float:
    """Standard deviation of the Gaussian whose weights over the cells have this variance [cells^2] [cells]."""
    if spread < 1e-9:
        return 0.0

    def variance(tried: float) -> float:
        weights = _weights(tried)
        places = np.arange(len(weights)) - len(weights) // 2
        return float(weights @ places**2 / weights.sum())

    return float(brentq(lambda tried: variance(tried) - spread, 0.05, 16.0, xtol=1e-15, rtol=1e-15))


def spot(spread: float) -> Any:
    """Weights of the cells along a line whose variance is `spread` [cells^2]."""
    return _weights(radius(spread)) if spread >= 1e-9 else np.ones(1)


def read(height: Any, x: float, y: float, spread: float) -> Any:
    """A displaced scan; beyond the border each cell reads as the nearest one, and a spot averages what lies inside."""
    weights = spot(spread)
    for axis in (0, 1) if len(weights) > 1 else ():
        inside = convolve1d(np.ones_like(height), weights, axis, mode="constant")
        height = convolve1d(height, weights, axis, mode="constant") / inside
    i, j = np.indices(height.shape)
    return map_coordinates(height, [i + x, j + y], order=1, mode="nearest")


def slopes(height: Any, x: float, y: float, spread: float) -> Any:
    """(3, nx, ny): change of the scan with x, y and spread, by centred differences of 0.02."""
    less, wider = max(0.0, spread - 0.02), spread + 0.02
    return np.stack(
        [
            (read(height, x + 0.02, y, spread) - read(height, x - 0.02, y, spread)) / 0.04,
            (read(height, x, y + 0.02, spread) - read(height, x, y - 0.02, spread)) / 0.04,
            (read(height, x, y, wider) - read(height, x, y, less)) / (wider - less),
        ]
    )


def curvature(height: Any) -> Any:
    framed = np.pad(height, 1, mode="edge")
    along_x = framed[2:, 1:-1] + framed[:-2, 1:-1] - 2.0 * height
    along_y = framed[1:-1, 2:] + framed[1:-1, :-2] - 2.0 * height
    return np.hypot(along_x, along_y)


@dataclass(frozen=True)
class Found:
    """What the scans have shown; the names are those of `Registration`."""

    estimate: Any
    covariance: Any
    applied: Any
    steps_variance: float = 0.03**2
    misfit: float = 0.05**2
    far_product: float = 0.0
    far_information: float = 0.0
    scans: int = 0
    has_shift: bool = False
    has_wide_spot: bool = False

    @property
    def mask(self) -> Any:
        """Which of the displacements are corrected."""
        return np.array([self.has_shift, self.has_shift, self.has_wide_spot])

    @property
    def displacement(self) -> tuple[float, ...]:
        """Shift along x and y and the larger of its errors, radius of the spot and its error [cells]."""
        spread = float(self.estimate[2]) if self.has_wide_spot else 0.0
        error = radius(spread + float(np.sqrt(self.covariance[2, 2]))) - radius(spread)
        return *self.estimate[:2], float(np.sqrt(np.diag(self.covariance)[:2].max())), radius(spread), error


@dataclass(frozen=True)
class Evidence:
    """Maps before the scan [m], [m^2], the response (3, nx, ny), the levelled scan, and what was seen."""

    known: Any
    predicted: Any
    variance: Any
    response: Any
    scan: Any
    valid: Any
    is_first_layer: bool
    noise: float

    def shifted(self, whole: Any) -> tuple[Any, Any]:
        """(scan, seen) on the cells of the plant, of a shift of whole cells."""
        cells = np.moveaxis(np.indices(self.scan.shape), 0, -1) - whole.astype(int)
        inside = np.all((cells >= 0) & (cells < self.scan.shape), axis=-1)
        at = tuple(np.moveaxis(np.where(inside[..., None], cells, 0), -1, 0))
        return self.scan[at], inside & self.valid[at]

    def surface(self, moved: Any, growth: float) -> Any:
        return self.predicted + growth * (self.predicted - self.known) + np.einsum("k,kij->ij", moved, self.response)


@dataclass(frozen=True)
class Linear:
    """The scan linearised: columns (nx, ny, 6), what is left of readings, their weights, walls, curvature."""

    columns: Any
    rest: Any
    weight: Any
    is_wall: Any
    curved: Any


def linearised(evidence: Evidence, found: Found, x: Any) -> Linear:
    now = NOW @ x
    whole = np.round(now[:2])
    left = (*(now[:2] - whole), now[2])
    surface = evidence.surface(x[:3] - found.applied, x[5])
    scan, seen = evidence.shifted(whole)
    rest = np.where(seen, scan - read(surface, *left), 0.0)
    curved, sure = curvature(surface), evidence.variance + evidence.noise + READING**2
    is_wall = curved**2 > WALL**2 * sure
    own = slopes(surface, *left)
    carried = np.array([read(each, *left) for each in evidence.response])
    growth = read(evidence.predicted - evidence.known, *left)
    columns = np.concatenate([np.where(is_wall, np.concatenate([own + carried, own[:2]]), 0.0), growth[None]])
    weight = np.where(seen, 1.0 / (sure + found.misfit * curved**2), 0.0)
    return Linear(np.moveaxis(columns, 0, -1), rest, weight, is_wall, curved)


def likeliest(evidence: Evidence, found: Found, is_iterated: bool) -> tuple[Any, Any, Linear]:
    """(unknowns, their covariance, the last linearisation)."""
    precision = np.zeros((6, 6))
    precision[:3, :3] = np.linalg.inv(found.covariance + np.diag([0.0, 0.0, 1e-6]))
    growth_std = 0.3 if evidence.is_first_layer else 0.03
    precision[3:, 3:] = np.diag([1.0 / found.steps_variance] * 2 + [growth_std**-2])
    before = np.concatenate([found.estimate, np.zeros(3)])
    x = before if is_iterated else np.concatenate([found.applied, np.zeros(3)])
    for turn in range(8 if is_iterated else 1):
        linear, move = linearised(evidence, found, x), np.zeros(6)
        A, rest, weight = linear.columns.reshape(-1, 6), linear.rest.ravel(), linear.weight.ravel()
        for _ in range(2):
            off = np.abs(rest - A @ move) * np.sqrt(weight)
            robust = np.where(off > HUBER, HUBER / np.maximum(off, HUBER), 1.0)
            robust = np.where((off > STRANGE) & (turn >= 3), 0.0, robust)
            matrix = precision + A.T @ ((weight * robust)[:, None] * A)
            move = np.linalg.solve(matrix, precision @ (before - x) + A.T @ (weight * robust * rest))
        x = x + move
        x[:2], x[2] = np.clip(x[:2], -4.0, 4.0), np.clip(x[2], 0.0, 16.0)
        if np.abs(move).max() < 1e-4 and turn >= 3:
            break
    return x, np.linalg.inv(matrix), linear


def learnt(evidence: Evidence, part: Any, before: Found, is_iterated: bool) -> tuple[Found, Any, Any, Linear]:
    """(what is known after the scan, unknowns, their covariance, the linearisation)."""
    x, covariance, linear = likeliest(evidence, before, is_iterated)
    now, of_now = NOW @ x, NOW @ covariance @ NOW.T
    steps = 0.5 * float(x[3:5] @ x[3:5] + np.trace(covariance[3:5, 3:5]))
    scans = before.scans + 1
    far = linear.is_wall & ~near(part)
    slope, weight = linear.columns[far][:, 2], linear.weight[far]
    spread = x[2] if is_iterated else 0.0
    product = before.far_product + float(np.sum(weight * slope * (linear.rest[far] + spread * slope)))
    information = before.far_information + float(np.sum(weight * slope**2))
    seen = linear.weight > 0.0
    squares = linear.curved[seen] ** 2
    of_curvature = float(linear.rest[seen] ** 2 @ squares / (squares @ squares)) if squares.any() else before.misfit
    after = replace(
        before,
        estimate=now,
        covariance=of_now,
        steps_variance=before.steps_variance + (steps - before.steps_variance) / (1 + scans),
        misfit=0.7 * before.misfit + 0.3 * (max(of_curvature, 1e-4) if squares.any() else before.misfit),
        far_product=product,
        far_information=information,
        scans=scans,
    )
    return decided(after, 30.0 * (doubt(linear, now) if is_iterated else 1.0), is_iterated), x, covariance, linear


def doubt(linear: Linear, now: Any) -> float:
    """Mean square of what is left where the displacement moves readings, in variances; at least 1."""
    moved = linear.columns[linear.is_wall][:, :3] @ now
    weight, rest = linear.weight[linear.is_wall], linear.rest[linear.is_wall]
    total = float(np.sum(weight * moved**2))
    return max(1.0, float(np.sum(weight * moved**2 * weight * rest**2)) / total) if total else 1.0


def decided(found: Found, limit: float, is_iterated: bool) -> Found:
    shift, spread = found.estimate[:2], found.estimate[2]
    has_shift, has_spot = found.has_shift, found.has_wide_spot
    is_beyond = shift @ np.linalg.solve(found.covariance[:2, :2], shift) > limit
    if is_beyond and np.hypot(*shift) > 0.05:
        has_shift = True
    if not is_beyond and limit > 30.0 and not has_spot:
        has_shift = False
    product, information = found.far_product, found.far_information
    shows_far = product > 0.0 and product**2 > 30.0 * information
    if shows_far and is_iterated:
        shows_far = abs(product / information - spread) < 0.25 * spread + 3.0 / np.sqrt(information)
    if shows_far and spread > 0.1 and spread**2 > limit * found.covariance[2, 2]:
        has_spot = True
    return replace(found, has_shift=has_shift, has_wide_spot=has_spot)


def confirmed(evidence: Evidence, part: Any, before: Found) -> tuple[Found, Any, Any, Linear]:
    """What a linear step finds is to stand the iteration, else nothing is corrected."""
    if before.mask.any():
        return learnt(evidence, part, before, True)
    once = learnt(evidence, part, before, False)
    if not once[0].mask.any():
        return once
    again = learnt(evidence, part, before, True)
    if again[0].mask.any():
        return again
    return replace(once[0], has_shift=False, has_wide_spot=False), *once[1:]


@dataclass(frozen=True)
class State:
    """Maps (nx, ny) [m], [m^2], layers; the response (3, nx, ny); what is known of the displacement."""

    height: Any
    variance: Any
    unseen: Any
    response: Any
    found: Found
    scans: int


class Estimator:
    """`noise`: of a reading [m^2]."""

    def __init__(self, job: Job, noise: float) -> None:
        self.part, self.noise = job.mask, noise
        self.layers = estimator_numpy.Estimator(job, noise, "off")

    def first(self, scan: Any, valid: Any) -> State:
        state = self.layers.first(scan, valid)
        response = np.where(near(~valid), 0.0, -slopes(state.height, 0.0, 0.0, 0.0))
        found = Found(np.zeros(3), 0.25 * np.eye(3), np.zeros(3))
        return State(state.height, state.variance, state.unseen, response, found, 1)

    def next(self, before: State, pattern: Any, scan: Any, valid: Any) -> State:
        layers, nominal = self.layers, self.layers.nominal
        predicted, scan = layers.printed(before.height, pattern, nominal), np.where(valid, scan, 0.0)
        was = before.found
        seen_before = read(predicted, *was.applied) if was.mask.any() else before.height
        scan = scan - estimator_numpy.drift(scan, seen_before, self.part, valid)[0]
        variance = before.variance + 0.01 * layers.squares(before.height, pattern, nominal)
        evidence = Evidence(
            before.height, predicted, variance, before.response, scan, valid, before.scans == 1, self.noise
        )
        found, x, covariance, linear = confirmed(evidence, self.part, was)
        found = replace(found, applied=np.where(found.mask, found.estimate, 0.0))
        known, misread = before.height, 0.0
        if found.mask.any():
            moved, whole = np.where(found.mask, x[:3] - was.applied, 0.0), np.round(found.applied[:2])
            surface = evidence.surface(moved, x[5])
            scan, valid = evidence.shifted(whole)
            left = (*(found.applied[:2] - whole), found.applied[2])
            scan = np.where(valid, scan - read(surface, *left) + surface, 0.0)
            known = before.height + np.einsum("k,kij->ij", moved, before.response)
            misread = READING**2 + found.misfit * curvature(surface) ** 2
        expected = layers.printed(known, pattern, nominal)
        spread = before.variance + 0.01 * layers.squares(known, pattern, nominal)
        error, surprise = self.noise + misread, (scan - expected) ** 2
        wide = np.where(surprise > 25.0 * (spread + error), surprise, spread)
        gain = np.where(valid, wide / (wide + error), 0.0)
        response, unexplained = carried(before.response, linear, covariance, gain)
        left_over = np.where(valid, (1.0 - gain) * wide, spread) + (unexplained if found.mask.any() else 0.0)
        unseen = np.where(valid, 0, before.unseen + 1)
        height = expected + gain * (scan - expected)
        return State(height, left_over, unseen, response, found, before.scans + 1)


def carried(before: Any, linear: Linear, covariance: Any, gain: Any) -> tuple[Any, Any]:
    """(response, variance that no displacement explains): errors of heights regressed on that of the displacement now.

    A height errs with the displacement before by its response, less the gain times the columns of the reading.
    """
    errs = np.zeros((*gain.shape, 6))
    errs[..., :3] = np.moveaxis(before, 0, -1)
    columns = linear.columns.copy()
    columns[~linear.is_wall, :3] = np.moveaxis(before, 0, -1)[~linear.is_wall]
    errs[..., :5] -= gain[..., None] * columns[..., :5]
    now = NOW @ covariance @ NOW.T
    of_before = covariance[:3] @ NOW.T @ np.linalg.inv(now)  # displacement before, per displacement now
    rest = covariance[:3, :3] - of_before @ NOW @ covariance[:, :3]
    steps = errs[..., 3:5]  # the shift now is that before and the step: the step is what the former leaves
    old = errs[..., :3] - np.concatenate([steps, np.zeros((*gain.shape, 1))], axis=-1)
    response = old @ of_before + np.concatenate([steps, np.zeros((*gain.shape, 1))], axis=-1)
    return np.moveaxis(response, -1, 0), np.einsum("ijk,kl,ijl->ij", old, rest, old)
