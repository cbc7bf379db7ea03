"""h1, h2, h3 of a layer-to-layer model from layers of any pattern, by regression that is unbiased under noise of the
scans.

The growth of a cell regressed on the measured surface is biased: the noise of a scan is in the growth and in the rates,
and it pulls the shares of the neighbours down, which saturate (errors in variables). Here each scan is predicted from
an estimate of the surface before the layer on the model that is being identified (`surface_filter`). It is independent
of the noise of the next scan, so the errors of the true heights have mean 0 for any pattern (prediction error method;
Ljung 1999, "System identification", chapter 7). The variation of a droplet's volume follows from the size of the
errors. To conserve volume, h1 of each material is the volume that its droplets have added (`droplet_volumes`) less the
other heights, and only these are fitted. The geometry of displaced scans is fitted with the heights: each round
improves the heights, then the geometry by their residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from inkloop.component import BoolMap
from inkloop_lab.identify.droplet_volume import Freedom, droplet_volumes, improved_heights
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord, first_guess
from inkloop_lab.identify.scan_geometry import GeometryFit, ScanGeometry
from inkloop_lab.identify.surface_filter import PLACE_STD, Innovation, innovations
from inkloop_lab.models.layer_deposition import HEIGHTS_BY_REACH

BLOCK = 4  # cells along each side of a block whose errors may depend on each other (assumed)
ROUNDS, AGREE = 40, 1e-4  # rounds, and change of the heights that ends them, as a share of a layer
GEOMETRY_ROUNDS, GEOMETRY_AGREES = 15, 1e-3  # the same for the geometry [cells]; heights: ten times AGREE
VARIANCE_AGREES = 0.1  # relative change of the droplet variance that ends its fit: it only weighs the errors
PERTURBATION = 1e-3  # perturbation of a height as a share of a layer, for the slope of the predictions
DROPLET_STD_FIRST = 0.3  # start value: large, so that early rounds rest on the scans (by trial)
PLACE_STD_FIRST = 0.1  # start value [cells]: large, so that walls do not count as variation of droplets (assumed)
MEDIAN_SQUARE = 0.455  # of a standard normal distribution
ERROR_LEAST = (
    3e-3  # least weight of a growth as a share of a layer: else a few growths of exact scans outweigh all (by trial)
)


@dataclass(frozen=True, eq=False)
class InkEstimate:
    """heights: (materials, 3, 6 or 10) [m]; covariance: of all of them in order [m^2], from errors that may depend on
    each other within a block of cells; degrees: of freedom of it; noise_std: of a reading [m]; droplet_std: of a
    droplet's increment, as a share, model errors included [1]; used: number of growths; place_std: of the place of a
    displaced reading [cells]; unexplained: robust variance of the residuals of cells that droplets reach, beyond the
    noise [m^2]; geometry: of the scans, and geometry_covariance: of its terms [cells^2], if fitted.
    """

    heights: NDArray[np.float64]
    covariance: NDArray[np.float64]
    degrees: int
    noise_std: float
    droplet_std: float
    used: int
    place_std: float = PLACE_STD
    unexplained: float = 0.0
    geometry: ScanGeometry | None = None
    geometry_covariance: NDArray[np.float64] | None = None

    @property
    def half_widths(self) -> NDArray[np.float64]:
        """Half widths of the 95 % confidence intervals, in the shape of the heights [m]."""
        factor = float(stdtrit(max(1, self.degrees), 0.975))
        return np.asarray(factor * np.sqrt(np.diag(self.covariance)).reshape(self.heights.shape))


@dataclass(frozen=True, eq=False)
class _Errors:
    """error: (n,) scan less prediction [m]; variance: its expected variance [m^2]; squares: squared increments of the
    droplets [m^2]; block: of cells and print; steepness: squares of the slopes of displaced readings [m^2 per cell^2];
    sensitivity: (8, n) of the predictions to the geometry [m per cell].
    """

    error: NDArray[np.float64]
    variance: NDArray[np.float64]
    squares: NDArray[np.float64]
    block: NDArray[np.int64]
    steepness: NDArray[np.float64]
    sensitivity: NDArray[np.float64]

    @classmethod
    def together(cls, parts: Sequence[_Errors]) -> _Errors:
        """Joins the errors of all layers of all prints."""
        names = ("error", "variance", "squares", "block", "steepness", "sensitivity")
        return cls(*(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names))


@dataclass(frozen=True)
class _Variances:
    """droplets: variance of a droplet's increment, as a share [1]; place: of the place of a displaced reading
    [cells^2].
    """

    droplets: float
    place: float

    def improved(self, errors: _Errors) -> _Variances:
        """The variances updated by the errors: droplets on even ground, and places at walls."""
        steep = self.place * errors.steepness > 0.5 * errors.variance
        droplets = self._of(errors, self.droplets, errors.squares, ~steep)
        return _Variances(droplets, max(self._of(errors, self.place, errors.steepness, steep), PLACE_STD**2))

    @staticmethod
    def _of(errors: _Errors, before: float, squares: NDArray[np.float64], counted: NDArray[np.bool_]) -> float:
        if not squares[counted].any():
            return before
        surplus = float(np.sum((errors.error**2 - errors.variance)[counted]) / np.sum(squares[counted]))
        wanted = float(np.clip(before + surplus, before / 10.0, 10.0 * before))
        return float(np.sqrt(wanted * before))  # damped: it changes the filter, and so the errors


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
    print (nx, ny), which growths count; geometries: of the scans by print, in register if not given; fit_geometry: that
    of the only print is fitted too, from there on. Raises IdentificationError where the patterns do not separate the
    heights, or the scans do not show the volume.
    """
    materials, count = max(record.materials for record in records), HEIGHTS_BY_REACH[reach]
    counted = cells or [np.ones(record.shape, np.bool_) for record in records]
    placed = [ScanGeometry.in_register(record.shape, len(record.pattern)) for record in records]
    placed = placed if geometries is None else list(geometries)
    guess = first_guess(records)
    heights = np.tile(guess * 0.1 ** np.minimum(np.arange(count), 2), (materials, 1))
    variances = _Variances(DROPLET_STD_FIRST**2 if correct else 0.0, PLACE_STD_FIRST**2)
    freedom = Freedom.of(heights.shape, droplet_volumes(records, materials, reach) if conserve else None)

    def errors_of(tried: NDArray[np.float64], tangent: bool = False) -> _Errors:
        parts = [
            layer
            for number, (record, mask) in enumerate(zip(records, counted, strict=True))
            for layer in _errors(
                record,
                innovations(
                    record, tried, noise_std, variances.droplets, placed[number], variances.place, correct, tangent
                ),
                mask,
                number,
            )
        ]
        return _Errors.together(parts)

    for _ in range(GEOMETRY_ROUNDS if fit_geometry else ROUNDS):
        errors = errors_of(heights, fit_geometry)
        sensitivity = _sensitivity(errors_of, heights, errors, PERTURBATION * guess)
        weight = (
            1.0 / np.maximum(errors.variance, (ERROR_LEAST * guess) ** 2) if correct else np.ones(errors.error.size)
        )
        last, before = heights, variances
        fit = GeometryFit.of(placed[0], errors.sensitivity, weight) if fit_geometry else None
        heights = improved_heights(sensitivity, weight, errors.error, heights, freedom)
        moved = 0.0
        if fit:
            step = fit.step(errors.error - (heights - last).ravel() @ sensitivity)
            moved, placed = float(np.abs(step).max()), [placed[0].moved(step)]
        variances = before.improved(errors) if correct else before
        change = abs(variances.droplets - before.droplets)
        agree = 10.0 * AGREE if fit_geometry else AGREE
        is_settled = np.abs(heights - last).max() <= agree * guess and moved <= GEOMETRY_AGREES
        if is_settled and change <= max(VARIANCE_AGREES * before.droplets, 1e-5):
            break
    if (heights < 0.0).any():
        raise IdentificationError(f"droplets add less than their neighbours get at a reach of {reach}; fit reach 1")
    covariance, degrees = _covariance(sensitivity, weight, errors, freedom)
    stds = [float(np.sqrt(each)) for each in (variances.droplets, variances.place)]
    left = errors.error[errors.squares > 0.0]
    unexplained = max(float(np.median(left**2)) / MEDIAN_SQUARE - noise_std**2, 0.0) if left.size else 0.0
    found = InkEstimate(heights, covariance, degrees, noise_std, stds[0], errors.error.size, stds[1], unexplained)
    if not fit:
        return found
    scattered, _ = _scattered(fit.weighted * errors.error, errors.block)
    return replace(found, geometry=placed[0], geometry_covariance=fit.inverse @ scattered @ fit.inverse)


def _sensitivity(
    errors_of: Callable[[NDArray[np.float64]], _Errors], heights: NDArray[np.float64], errors: _Errors, by: float
) -> NDArray[np.float64]:
    """(heights, errors): derivative of the predictions with respect to each height."""
    found = []
    for index in np.ndindex(heights.shape):
        changed = heights.copy()
        changed[index] += by
        found.append((errors.error - errors_of(changed).error) / by)
    return np.array(found)


def _errors(record: PrintRecord, steps: Iterator[Innovation], cells: BoolMap, number: int) -> Iterator[_Errors]:
    """The layers of print `number`."""
    block = _blocks(record.shape) + (number << 32)
    for step in steps:
        counted = cells[step.usable]
        parts = (step.error, step.variance, step.squares, block[step.usable], step.steepness, step.sensitivity)
        yield _Errors(*(part[..., counted] for part in parts))  # type: ignore[arg-type]


def _blocks(shape: tuple[int, int]) -> NDArray[np.int64]:
    i, j = np.indices(shape) // BLOCK
    return np.asarray(i * (shape[1] // BLOCK + 1) + j, np.int64)


def _covariance(
    sensitivity: NDArray[np.float64], weight: NDArray[np.float64], errors: _Errors, freedom: Freedom
) -> tuple[NDArray[np.float64], int]:
    """Covariance of the heights, by blocks of cells over all layers of a print (sandwich estimate), and its degrees of
    freedom.
    """
    own = freedom.basis.T @ sensitivity
    inverse = freedom.basis @ np.linalg.inv((own * weight) @ own.T)
    scattered, count = _scattered(own * weight * errors.error, errors.block)
    degrees = max(1, count - len(own))
    return inverse @ scattered @ inverse.T * count / degrees, degrees


def _scattered(scores: NDArray[np.float64], block: NDArray[np.int64]) -> tuple[NDArray[np.float64], int]:
    """Covariance of the sums of scores (terms, n), correlated within blocks, and the number of blocks."""
    _, number = np.unique(block, return_inverse=True)
    count = int(number.max()) + 1
    sums = np.array([np.bincount(number, terms, count) for terms in scores])
    return sums @ sums.T, count
