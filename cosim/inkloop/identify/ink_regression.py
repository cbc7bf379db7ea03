"""h1, h2, h3 of a layer-to-layer model from layers of any pattern, by regression that noise in the scans does not bias.

The growth of a cell regressed on the measured surface is biased: the noise of a scan is in the growth and in the rates,
and it pulls the shares of the neighbours down, which saturate (errors in variables). Here each scan is predicted from
an estimate of the surface before the layer - a Kalman filter per cell over all earlier scans, on the model that is
being identified, around a plane or a rough start surface - with the mean of the rates over what that surface may have
been (`expected_increments`). The noise of the next scan is in neither, so the errors of the true heights have no mean
whatever the patterns (prediction error method; Ljung 1999, "System identification", chapter 7). What a droplet's volume
varies by follows from the size of the errors. Where volume is to be conserved, h1 of each material is what the other
heights leave of the volume that its droplets have added (`droplet_volumes`), and only the others are fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.optimize import nnls
from scipy.special import stdtrit

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import IdentificationError
from inkloop.identify.droplet_volume import Freedom, droplet_volumes
from inkloop.identify.expected_increments import expected_rates
from inkloop.identify.print_record import PrintRecord
from inkloop.models.layer_deposition import HEIGHTS_BY_REACH
from inkloop.units import UM_PER_M

BLOCK = 4  # cells along each side of a block whose errors may depend on each other (assumed)
ROUNDS, AGREE = 40, 1e-4  # until a round changes no height by more than that share of a layer
VARIANCE_AGREES = 0.1  # of droplet volumes, share of itself: it weighs, no more
PERTURBATION = 1e-3  # of a height, as a share of a layer, for the slope of the predictions
DROPLET_STD_FIRST = 0.3  # to begin with: large, so that early rounds rest on the scans (by trial)
FLATNESS = 2.0  # standard deviations of its variance that scan 0 of a plane may show beyond the noise (assumed)
SINGULAR = 1e-6  # smallest over largest information; below, the patterns do not determine it (assumed)
ERROR_LEAST = (
    3e-3  # that a growth is weighed by, as a share of a layer: else a few of exact scans outweigh all (by trial)
)


@dataclass(frozen=True, eq=False)
class InkEstimate:
    """heights: (materials, 3, 6 or 10) [m]; covariance: of all of them in order [m^2], from errors that may depend on
    each other within a block of cells; degrees: of freedom of it; noise_std: of a reading [m]; droplet_std: of what a
    droplet adds, as a share, with all that the model does not explain [1]; used: growths that it rests on.
    """

    heights: NDArray[np.float64]
    covariance: NDArray[np.float64]
    degrees: int
    noise_std: float
    droplet_std: float
    used: int

    @property
    def half_widths(self) -> NDArray[np.float64]:
        """Of the 95 % confidence intervals, in the shape of the heights [m]."""
        factor = float(stdtrit(max(1, self.degrees), 0.975))
        return np.asarray(factor * np.sqrt(np.diag(self.covariance)).reshape(self.heights.shape))


@dataclass(frozen=True, eq=False)
class _Errors:
    """error: (n,) scan less prediction [m]; variance: expected of it [m^2]; squares: of what the droplets add [m^2];
    block: of cells and print.
    """

    error: NDArray[np.float64]
    variance: NDArray[np.float64]
    squares: NDArray[np.float64]
    block: NDArray[np.int64]

    @classmethod
    def together(cls, parts: Sequence[_Errors]) -> _Errors:
        """All layers of all prints."""
        arrays = zip(*((part.error, part.variance, part.squares, part.block) for part in parts), strict=True)
        return cls(*(np.concatenate(of_parts) for of_parts in arrays))


def identify_ink(
    records: Sequence[PrintRecord],
    noise_std: float,
    *,
    reach: int = 1,
    correct: bool = True,
    conserve: bool = False,
    cells: Sequence[BoolMap] | None = None,
) -> InkEstimate:
    """The heights whose predictions of the next scan err least (Gauss-Newton on the weighted prediction errors).

    noise_std: of a reading [m]; correct: False predicts from the measured surface as it is, for comparison; conserve:
    the heights add up to the volume of a droplet, which is measured over whole prints and taken as known; cells: by
    print (nx, ny), which growths count. Raises IdentificationError where the patterns do not separate the heights, or
    the scans do not show the volume.
    """
    materials, count = max(record.materials for record in records), HEIGHTS_BY_REACH[reach]
    counted = cells or [np.ones(record.shape, np.bool_) for record in records]
    guess = first_guess(records)
    heights = np.tile(guess * 0.1 ** np.minimum(np.arange(count), 2), (materials, 1))
    droplet_variance = DROPLET_STD_FIRST**2 if correct else 0.0
    freedom = Freedom.of(heights.shape, droplet_volumes(records, materials, reach) if conserve else None)

    def errors_of(tried: NDArray[np.float64]) -> _Errors:
        parts = [
            layer
            for number, (record, mask) in enumerate(zip(records, counted, strict=True))
            for layer in _errors(record, tried, noise_std, droplet_variance, correct, mask, number)
        ]
        return _Errors.together(parts)

    for _ in range(ROUNDS):
        errors = errors_of(heights)
        sensitivity = _sensitivity(errors_of, heights, errors, PERTURBATION * guess)
        weight = (
            1.0 / np.maximum(errors.variance, (ERROR_LEAST * guess) ** 2) if correct else np.ones(errors.error.size)
        )
        last, before = heights, droplet_variance
        heights = _improved(sensitivity, weight, errors.error, heights, freedom)
        if correct and errors.squares.any():
            surplus = float(np.sum(errors.error**2 - errors.variance) / np.sum(errors.squares))
            wanted = float(np.clip(before + surplus, before / 10.0, 10.0 * before))
            droplet_variance = float(np.sqrt(wanted * before))  # half the way: the filter follows, and errors with it
        change = abs(droplet_variance - before)
        if np.abs(heights - last).max() <= AGREE * guess and change <= max(VARIANCE_AGREES * before, 1e-5):
            break
    if (heights < 0.0).any():
        raise IdentificationError(f"droplets add less than their neighbours get at a reach of {reach}; fit reach 1")
    covariance, degrees = _covariance(sensitivity, weight, errors, freedom)
    return InkEstimate(heights, covariance, degrees, noise_std, float(np.sqrt(droplet_variance)), errors.error.size)


def _sensitivity(
    errors_of: Callable[[NDArray[np.float64]], _Errors], heights: NDArray[np.float64], errors: _Errors, by: float
) -> NDArray[np.float64]:
    """(heights, errors): by how much the predictions grow per metre of each height."""
    found = []
    for index in np.ndindex(heights.shape):
        changed = heights.copy()
        changed[index] += by
        found.append((errors.error - errors_of(changed).error) / by)
    return np.array(found)


def first_guess(records: Sequence[PrintRecord]) -> float:
    """Mean height that a droplet adds to the whole grid [m], for widths to begin with. Raises IdentificationError."""
    growth = sum(float(np.nansum(np.diff(record.measured, axis=0))) for record in records)
    droplets = sum(int(np.count_nonzero(record.pattern)) for record in records)
    if droplets == 0:
        raise IdentificationError("no layer has a droplet; log the patterns as they were jetted")
    if growth <= 0.0:
        raise IdentificationError(
            f"the surface sank by {-growth / droplets * UM_PER_M:.3g} µm per droplet; expected it to grow; check the "
            "sign of the heights, the level of the scans (datum), and that each scan belongs to its pattern"
        )
    return growth / droplets


def _errors(
    record: PrintRecord,
    heights: NDArray[np.float64],
    noise_std: float,
    droplet_variance: float,
    correct: bool,
    cells: BoolMap,
    number: int,
) -> Iterator[_Errors]:
    """The layers of print `number`, each predicted from what the scans before it show of its surface."""
    noise = noise_std**2
    mean, variance = start_surface(record.measured[0], noise_std)
    reach = {count: reach for reach, count in HEIGHTS_BY_REACH.items()}[heights.shape[1]]
    block = _blocks(record.shape) + (number << 32)
    for layer in record.layers():
        if not correct:
            seen = np.isfinite(layer.before)
            mean, variance = np.where(seen, layer.before, 0.0), np.where(seen, 0.0, np.inf)
        known = np.isfinite(variance)
        rates, squares = expected_rates(mean, np.where(known, variance, 0.0), layer.pattern, heights, layer.colours)
        predicted, squares = mean + np.tensordot(heights, rates), _evened(squares, rates)
        spread = variance + droplet_variance * squares
        usable = cells & np.isfinite(layer.after) & ~maximum_filter(~known, 2 * reach + 1, mode="constant", cval=False)
        yield _Errors((layer.after - predicted)[usable], spread[usable] + noise, squares[usable], block[usable])
        if correct:
            mean, variance = _corrected(predicted, spread, layer.after, noise)


def _evened(squares: FloatMap, rates: NDArray[np.float64]) -> FloatMap:
    """Their mean wherever droplets reach: what a model does not explain is no smaller where droplets add little."""
    reached = (rates > 0.0).any(axis=(0, 1))
    return np.where(reached, squares[reached].mean() if reached.any() else 0.0, 0.0)


def _corrected(predicted: FloatMap, spread: FloatMap, scan: FloatMap, noise: float) -> tuple[FloatMap, FloatMap]:
    """Kalman correction of each cell: (height [m], variance [m^2]); a cell that was never seen takes the scan."""
    seen, total = np.isfinite(scan), spread + noise
    gain = np.divide(spread, total, out=np.ones_like(spread), where=np.isfinite(spread) & (total > 0.0))
    height = predicted + np.where(seen, gain * np.where(seen, scan - predicted, 0.0), 0.0)
    return height, np.where(seen, gain * noise, spread)


def start_surface(scan: FloatMap, noise_std: float) -> tuple[FloatMap, FloatMap]:
    """What is known of the start surface: (mean, variance) [m], [m^2], the variance infinite where it was not seen.

    A plane, if the scan is as even as its noise; else a rough plane whose roughness is normal (empirical Bayes).
    """
    seen = np.isfinite(scan)
    i, j = np.indices(scan.shape)
    terms = np.stack([np.ones(scan.shape), i / scan.shape[0], j / scan.shape[1]], axis=-1)
    if np.count_nonzero(seen) <= terms.shape[-1]:
        return np.zeros(scan.shape), np.full(scan.shape, np.inf)
    plane = terms @ np.linalg.lstsq(terms[seen], scan[seen], rcond=None)[0]
    freedom = np.count_nonzero(seen) - terms.shape[-1]
    noise = noise_std**2
    rough = float(np.sum((scan - plane)[seen] ** 2) / freedom) - noise
    if rough <= FLATNESS * noise * np.sqrt(2.0 / freedom):
        return plane, np.full(scan.shape, noise * terms.shape[-1] / np.count_nonzero(seen))
    gain = rough / (rough + noise)
    mean = np.where(seen, plane + gain * np.where(seen, scan - plane, 0.0), plane)
    return mean, np.where(seen, gain * noise, np.inf)


def _blocks(shape: tuple[int, int]) -> NDArray[np.int64]:
    i, j = np.indices(shape) // BLOCK
    return np.asarray(i * (shape[1] // BLOCK + 1) + j, np.int64)


def _improved(
    sensitivity: NDArray[np.float64],
    weight: NDArray[np.float64],
    error: NDArray[np.float64],
    heights: NDArray[np.float64],
    freedom: Freedom,
) -> NDArray[np.float64]:
    """Heights of at least 0 with the least weighted squares. Raises IdentificationError where one is not determined."""
    if error.size == 0:
        raise IdentificationError("no cell was measured after a layer whose surroundings had been measured before it")
    total, basis = float(weight.sum()), freedom.basis
    information = (sensitivity * weight) @ sensitivity.T / total
    reduced = basis.T @ information @ basis
    values, vectors = np.linalg.eigh(reduced)
    if values[0] < SINGULAR * values[-1]:
        undetermined = vectors[:, values < SINGULAR * values[-1]]
        mixed = freedom.chosen[(np.abs(undetermined) > 0.1).any(axis=1)]
        named = ", ".join(f"h{k % heights.shape[1] + 1} of material {'AB'[k // heights.shape[1]]}" for k in mixed)
        raise IdentificationError(
            f"the patterns do not separate {named} from the others; print single droplets, stripes and "
            "checkerboards, or random patterns too"
        )
    chosen = heights.ravel()[freedom.chosen]
    away = heights.ravel() - freedom.heights(chosen)  # of the first guess, which need not conserve
    free = chosen + np.linalg.solve(reduced, basis.T @ (information @ away + (sensitivity * weight) @ error / total))
    root = np.linalg.cholesky(reduced).T
    return freedom.heights(nnls(root, root @ free)[0]).reshape(heights.shape)


def _covariance(
    sensitivity: NDArray[np.float64], weight: NDArray[np.float64], errors: _Errors, freedom: Freedom
) -> tuple[NDArray[np.float64], int]:
    """Of the heights, by blocks of cells over all layers of a print (sandwich estimate), and its degrees of freedom."""
    own = freedom.basis.T @ sensitivity
    inverse = freedom.basis @ np.linalg.inv((own * weight) @ own.T)
    _, block = np.unique(errors.block, return_inverse=True)
    count = int(block.max()) + 1
    scores = np.array([np.bincount(block, terms, count) for terms in own * weight * errors.error])
    degrees = max(1, count - len(own))
    return inverse @ (scores @ scores.T) @ inverse.T * count / degrees, degrees
