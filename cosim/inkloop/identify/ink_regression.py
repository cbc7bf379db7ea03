"""h1, h2, h3 of a layer-to-layer model from layers of any pattern, by regression that noise in the scans does not bias.

The growth of a cell regressed on the measured surface is biased: the noise of a scan is in the growth and in the rates,
and it pulls the shares of the neighbours down, which saturate (errors in variables). Here each scan is predicted from
an estimate of the surface before the layer on the model that is being identified (`surface_filter`). The noise of the
next scan is not in it, so the errors of the true heights have no mean whatever the patterns (prediction error method;
Ljung 1999, "System identification", chapter 7). What a droplet's volume varies by follows from the size of the errors.
Where volume is to be conserved, h1 of each material is what the other heights leave of the volume that its droplets
have added (`droplet_volumes`), and only the others are fitted. The geometry of displaced scans is fitted with the
heights: each round improves the heights by what the geometry does not explain (variable projection; Golub, Pereyra
1973), then the geometry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.special import stdtrit

from inkloop.component import BoolMap
from inkloop.errors import IdentificationError
from inkloop.identify.droplet_volume import Freedom, droplet_volumes
from inkloop.identify.print_record import PrintRecord
from inkloop.identify.scan_geometry import ScanGeometry
from inkloop.identify.surface_filter import Innovation, innovations
from inkloop.models.layer_deposition import HEIGHTS_BY_REACH
from inkloop.units import UM_PER_M

BLOCK = 4  # cells along each side of a block whose errors may depend on each other (assumed)
ROUNDS, AGREE = 40, 1e-4  # until a round changes no height by more than that share of a layer
GEOMETRY_ROUNDS, GEOMETRY_AGREES = 15, 1e-3  # of a fit of the geometry; [cells], and of heights ten times AGREE
LONGEST_MOVE = 0.5  # [cells], of the geometry in a round (assumed)
VARIANCE_AGREES = 0.1  # of droplet volumes, share of itself: it weighs, no more
PERTURBATION = 1e-3  # of a height, as a share of a layer, for the slope of the predictions
DROPLET_STD_FIRST = 0.3  # to begin with: large, so that early rounds rest on the scans (by trial)
SINGULAR = 1e-6  # smallest over largest information; below, the patterns do not determine it (assumed)
ERROR_LEAST = (
    3e-3  # that a growth is weighed by, as a share of a layer: else a few of exact scans outweigh all (by trial)
)


@dataclass(frozen=True, eq=False)
class InkEstimate:
    """heights: (materials, 3, 6 or 10) [m]; covariance: of all of them in order [m^2], from errors that may depend on
    each other within a block of cells; degrees: of freedom of it; noise_std: of a reading [m]; droplet_std: of what a
    droplet adds, as a share, with all that the model does not explain [1]; used: growths that it rests on; geometries:
    of the scans, by print; geometry_covariance: of their terms, fitted together [cells^2].
    """

    heights: NDArray[np.float64]
    covariance: NDArray[np.float64]
    degrees: int
    noise_std: float
    droplet_std: float
    used: int
    geometries: tuple[ScanGeometry, ...] = ()
    geometry_covariance: NDArray[np.float64] | None = None

    @property
    def half_widths(self) -> NDArray[np.float64]:
        """Of the 95 % confidence intervals, in the shape of the heights [m]."""
        factor = float(stdtrit(max(1, self.degrees), 0.975))
        return np.asarray(factor * np.sqrt(np.diag(self.covariance)).reshape(self.heights.shape))


@dataclass(frozen=True, eq=False)
class _Errors:
    """error: (n,) scan less prediction [m]; variance: expected of it [m^2]; squares: of what the droplets add [m^2];
    block: of cells and print; wall: steep ones, that show the geometry; sensitivity: (terms, n) of the predictions to
    the geometries [m per cell].
    """

    error: NDArray[np.float64]
    variance: NDArray[np.float64]
    squares: NDArray[np.float64]
    block: NDArray[np.int64]
    wall: NDArray[np.bool_]
    sensitivity: NDArray[np.float64]

    @classmethod
    def together(cls, parts: Sequence[_Errors]) -> _Errors:
        """All layers of all prints."""
        names = ("error", "variance", "squares", "block", "wall", "sensitivity")
        return cls(*(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names))


def identify_ink(
    records: Sequence[PrintRecord],
    noise_std: float,
    *,
    reach: int = 1,
    correct: bool = True,
    conserve: bool = False,
    cells: Sequence[BoolMap] | None = None,
    geometries: Sequence[ScanGeometry] | None = None,
    fit_geometry: bool = False,
) -> InkEstimate:
    """The heights whose predictions of the next scan err least (Gauss-Newton on the weighted prediction errors).

    noise_std: of a reading [m]; correct: False predicts from the measured surface as it is, for comparison; conserve:
    the heights add up to the volume of a droplet, which is measured over whole prints and taken as known; cells: by
    print (nx, ny), which growths count; geometries: of the scans by print, in register if not given; fit_geometry:
    they are fitted too, from there on. Raises IdentificationError where the patterns do not separate the heights, or
    the scans do not show the volume.
    """
    materials, count = max(record.materials for record in records), HEIGHTS_BY_REACH[reach]
    counted = cells or [np.ones(record.shape, np.bool_) for record in records]
    placed = [ScanGeometry.in_register(record.shape, len(record.pattern)) for record in records]
    placed = placed if geometries is None else list(geometries)
    guess = first_guess(records)
    heights = np.tile(guess * 0.1 ** np.minimum(np.arange(count), 2), (materials, 1))
    droplet_variance = DROPLET_STD_FIRST**2 if correct else 0.0
    freedom = Freedom.of(heights.shape, droplet_volumes(records, materials, reach) if conserve else None)

    def errors_of(tried: NDArray[np.float64], tangent: bool = False) -> _Errors:
        parts = [
            layer
            for number, (record, mask) in enumerate(zip(records, counted, strict=True))
            for layer in _errors(
                record,
                innovations(record, tried, noise_std, droplet_variance, placed[number], correct, tangent),
                mask,
                (number, len(records)),
            )
        ]
        return _Errors.together(parts)

    for _ in range(GEOMETRY_ROUNDS if fit_geometry else ROUNDS):
        errors = errors_of(heights, fit_geometry)
        sensitivity = _sensitivity(errors_of, heights, errors, PERTURBATION * guess)
        weight = (
            1.0 / np.maximum(errors.variance, (ERROR_LEAST * guess) ** 2) if correct else np.ones(errors.error.size)
        )
        last, before = heights, droplet_variance
        fit = _GeometryFit.of(placed, errors, weight) if fit_geometry else None
        own = sensitivity if fit is None else fit.left_of(sensitivity)
        heights = _improved(own, weight, errors.error, heights, freedom)
        moved = 0.0
        if fit is not None:
            explained = np.tensordot((heights - last).ravel(), sensitivity, 1)
            step = fit.step(placed, errors.error - explained)
            moved = float(np.abs(step).max())
            placed = [replace(one, terms=one.terms + part) for one, part in zip(placed, step, strict=True)]
        even = ~errors.wall
        if correct and errors.squares[even].any():
            surplus = float(np.sum((errors.error**2 - errors.variance)[even]) / np.sum(errors.squares[even]))
            wanted = float(np.clip(before + surplus, before / 10.0, 10.0 * before))
            droplet_variance = float(np.sqrt(wanted * before))  # half the way: the filter follows, and errors with it
        change = abs(droplet_variance - before)
        agree = 10.0 * AGREE if fit_geometry else AGREE
        is_settled = np.abs(heights - last).max() <= agree * guess and moved <= GEOMETRY_AGREES
        if is_settled and change <= max(VARIANCE_AGREES * before, 1e-5):
            break
    if (heights < 0.0).any():
        raise IdentificationError(f"droplets add less than their neighbours get at a reach of {reach}; fit reach 1")
    covariance, degrees = _covariance(own, weight, errors, freedom)
    found = heights, covariance, degrees, noise_std, float(np.sqrt(droplet_variance)), errors.error.size
    return InkEstimate(*found, tuple(placed), None if fit is None else fit.covariance(errors))


@dataclass(frozen=True, eq=False)
class _GeometryFit:
    """Normal equations of the geometries about their present terms."""

    weighted: NDArray[np.float64]
    sensitivity: NDArray[np.float64]
    precision: NDArray[np.float64]
    inverse: NDArray[np.float64]

    @classmethod
    def of(cls, geometries: Sequence[ScanGeometry], errors: _Errors, weight: NDArray[np.float64]) -> _GeometryFit:
        weighted = errors.sensitivity * weight
        precision = np.concatenate([one.prior_precision for one in geometries])
        inverse = np.linalg.inv(weighted @ errors.sensitivity.T + np.diag(precision))
        return cls(weighted, errors.sensitivity, precision, inverse)

    def left_of(self, sensitivity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of the (heights, errors) sensitivity, what no geometry explains."""
        return sensitivity - sensitivity @ self.weighted.T @ self.inverse @ self.sensitivity

    def step(self, geometries: Sequence[ScanGeometry], error: NDArray[np.float64]) -> NDArray[np.float64]:
        """(prints, 8): change of the terms, not too long a one [cells]."""
        terms = np.concatenate([one.terms for one in geometries])
        step = self.inverse @ (self.weighted @ error - self.precision * terms)
        longest = np.abs(step).max()
        return np.asarray(step * min(1.0, LONGEST_MOVE / max(longest, LONGEST_MOVE))).reshape(len(geometries), -1)

    def covariance(self, errors: _Errors) -> NDArray[np.float64]:
        """Of all terms, by blocks of cells [cells^2]."""
        return self.inverse @ _scattered(self.weighted * errors.error, errors.block)[0] @ self.inverse


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
    record: PrintRecord, steps: Iterator[Innovation], cells: BoolMap, number: tuple[int, int]
) -> Iterator[_Errors]:
    """The layers of print `number` of so many."""
    place, prints = number
    block = _blocks(record.shape) + (place << 32)
    for step in steps:
        counted = cells[step.usable]
        own = step.sensitivity[:, counted]
        geometry = np.zeros((prints, *own.shape))
        geometry[place] = own
        parts = (step.error, step.variance, step.squares, block[step.usable], step.wall)
        yield _Errors(*(part[counted] for part in parts), geometry.reshape(-1, own.shape[1]))  # type: ignore[arg-type]


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
    scattered, count = _scattered(own * weight * errors.error, errors.block)
    degrees = max(1, count - len(own))
    return inverse @ scattered @ inverse.T * count / degrees, degrees


def _scattered(scores: NDArray[np.float64], block: NDArray[np.int64]) -> tuple[NDArray[np.float64], int]:
    """Covariance of the sums of scores (terms, n) that may depend on each other within a block, and all blocks."""
    _, number = np.unique(block, return_inverse=True)
    count = int(number.max()) + 1
    sums = np.array([np.bincount(number, terms, count) for terms in scores])
    return sums @ sums.T, count
