"""Kalman filter of the surface of a print over its scans, and the innovation of each scan, for a given ink.

The start surface is a plane or rough. Each layer is predicted from the estimate before it, with the mean of the rates
over the distribution of that surface (`expected_increments`), read through the geometry of the scan, and corrected by
its readings. Errors of the surface are assumed independent from cell to cell; readings between the cells correct the
cells around them (conjugate gradients).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.sparse import csr_array

from inkloop.component import BoolMap, FloatMap
from inkloop_lab.identify.expected_increments import expected_rates
from inkloop_lab.identify.print_record import PrintRecord
from inkloop_lab.identify.scan_geometry import TERMS, ScanGeometry
from inkloop_lab.models.layer_deposition import HEIGHTS_BY_REACH

FLATNESS = 2.0  # standard deviations of its variance by which scan 0 of a plane may exceed the noise (assumed)
UNSEEN = 2e-6  # [m^2]: variance of a height never measured, larger than that of any surface (assumed)
PLACE_STD = 0.004  # [cells]: least standard deviation of a displaced reading's place, as in the observer
EXACT = 1e-30  # [m^2]: variance of noiseless readings, to divide by
SOLVED, STEPS_MOST = 1e-3, 20  # of the corrections: relative residual of conjugate gradients, and steps

Vectors = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Innovation:
    """Innovation of a scan: its difference from the prediction. surface: (nx, ny) after the correction [m]; usable:
    (nx, ny); error: (n,) of the usable cells, scan less prediction [m]; variance: its expected variance [m^2]; squares:
    squared increments of the droplets [m^2]; sensitivity: (8, n) derivatives of the prediction with respect to the
    terms of the geometry [m per cell], (0, n) if not requested; steepness: (n,) squares of the slopes of displaced
    readings, else 0 [m^2 per cell^2].
    """

    surface: FloatMap
    usable: BoolMap
    error: Vectors
    variance: Vectors
    squares: Vectors
    sensitivity: Vectors
    steepness: Vectors


def innovations(
    record: PrintRecord,
    heights: NDArray[np.float64],
    noise_std: float,
    droplet_variance: float,
    geometry: ScanGeometry,
    place_variance: float = PLACE_STD**2,
    correct: bool = True,
    tangent: bool = False,
) -> Iterator[Innovation]:
    """Every scan after the first against the estimate before it; heights: (materials, 3, 6 or 10) [m].

    place_variance: of the place of a displaced reading [cells^2]; correct: False predicts from the measured surface as
    it is, for scans in register; tangent: with the sensitivity to the geometry, else to no terms.
    """
    shape, noise = record.shape, noise_std**2
    reach = {count: reach for reach, count in HEIGHTS_BY_REACH.items()}[heights.shape[1]]
    mean, variance = first_surface(record.measured[0], noise_std, geometry)
    follows = np.zeros((mean.size, TERMS if tangent else 0))
    for layer in record.layers():
        if not correct:
            seen = np.isfinite(layer.before)
            mean, variance = np.where(seen, layer.before, 0.0), np.where(seen, 0.0, UNSEEN)
        known = variance < 0.5 * UNSEEN
        rates, squares = expected_rates(mean, np.where(known, variance, 0.0), layer.pattern, heights, layer.colours)
        predicted, squares = mean + np.tensordot(heights, rates), _evened(squares, rates)
        view = _View.of(geometry, layer.number, predicted, noise, place_variance, follows.shape[1])
        spread = np.minimum(variance + droplet_variance * squares, UNSEEN)
        own = view.sensitivity + (view.sampling @ follows).T
        error = layer.after.ravel() - view.sampling @ predicted.ravel()
        near_unknown = maximum_filter(~known, 2 * reach + 1, mode="constant", cval=False).ravel()
        usable = np.isfinite(error) & (view.sampling @ near_unknown.astype(np.float64) == 0.0)
        expected = view.squared @ spread.ravel() + view.noise
        of_droplets = view.squared @ squares.ravel()
        if correct:
            mean, variance, follows = view.corrected(predicted, spread, error, follows, own)
        parts = error[usable], expected[usable], of_droplets[usable], own[:, usable], view.steepness[usable]
        yield Innovation(mean, usable.reshape(shape), *parts)


def first_surface(scan: FloatMap, noise_std: float, geometry: ScanGeometry) -> tuple[FloatMap, FloatMap]:
    """(mean, variance) [m], [m^2] of the start surface by scan 0 of this geometry; UNSEEN where it was not seen."""
    if geometry.is_none:
        mean, variance = start_surface(scan, noise_std)
        return mean, np.minimum(variance, UNSEEN)
    plane, rough, known = _plane(scan, noise_std)
    if rough == 0.0:
        return plane, np.minimum(known, UNSEEN)
    view = _View.of(geometry, 0, plane, noise_std**2, 0.0, 0)
    error = scan.ravel() - view.sampling @ plane.ravel()
    nothing = np.zeros((0, error.size))
    mean, variance, _ = view.corrected(plane, np.full(scan.shape, rough), error, nothing.T, nothing)
    return mean, np.where(variance < rough, variance, UNSEEN)


@dataclass(frozen=True, eq=False)
class _View:
    """Reading of the surface by a scan: sampling (cells, cells), its squares, noise of the readings (cells,) [m^2],
    squares of the slopes of displaced ones [m^2 per cell^2], and (8, cells) sensitivity to the geometry [m per cell].
    """

    sampling: csr_array
    squared: csr_array
    noise: Vectors
    steepness: Vectors
    sensitivity: Vectors

    @classmethod
    def of(
        cls, geometry: ScanGeometry, scan: int, surface: FloatMap, noise: float, place_variance: float, terms: int
    ) -> _View:
        """With the sensitivity to the first `terms` terms."""
        sampling, even = geometry.sampling(scan), np.full(surface.size, noise)
        if geometry.is_none and terms == 0:
            return cls(sampling, sampling, even, np.zeros(surface.size), np.zeros((0, surface.size)))
        slopes = geometry.slopes(scan, surface)
        sensitivity = geometry.sensitivity(scan, slopes)[:terms]
        if geometry.is_none:
            return cls(sampling, sampling, even, np.zeros(surface.size), sensitivity)
        steepness = np.sum(slopes**2, axis=0)
        return cls(sampling, sampling.power(2), even + place_variance * steepness, steepness, sensitivity)

    def corrected(
        self, predicted: FloatMap, spread: FloatMap, error: Vectors, tangent: Vectors, own: Vectors
    ) -> tuple[FloatMap, FloatMap, Vectors]:
        """Height [m], variance [m^2] and (cells, 8) tangent to the geometry after the correction by a scan."""
        seen, before = np.isfinite(error), spread.ravel()
        rests = np.column_stack([np.where(seen, error, 0.0), np.where(seen, -own, 0.0).T])
        diagonal = self.squared @ before + self.noise

        def covariance(x: Vectors) -> Vectors:
            carried = self.sampling @ (before[:, None] * (self.sampling.T @ x))
            return np.where(seen[:, None], carried + self.noise[:, None] * x, 0.0)

        is_plain = self.squared is self.sampling  # readings of the cells themselves
        scaled = _divided(rests, diagonal) if is_plain else _solved(covariance, diagonal, rests)
        change = before[:, None] * (self.sampling.T @ scaled)
        certainty = self.squared.T @ np.where(seen, 1.0 / np.maximum(self.noise, EXACT), 0.0)
        height = predicted + change[:, 0].reshape(predicted.shape)
        return height, (before / (1.0 + before * certainty)).reshape(spread.shape), tangent + change[:, 1:]


def _divided(rest: Vectors, diagonal: Vectors) -> Vectors:
    """(n, k) rest over diagonal, 0 where that is 0."""
    return np.divide(rest, diagonal[:, None], out=np.zeros_like(rest), where=diagonal[:, None] > 0.0)


def _solved(times: Callable[[Vectors], Vectors], diagonal: Vectors, right: Vectors) -> Vectors:
    """x of A x = right for each column, by conjugate gradients; times: A, symmetric; diagonal: of it."""
    x, rest = np.zeros_like(right), right
    steep = _divided(rest, diagonal)
    along, size = steep, np.sum(rest * steep, axis=0)
    wanted = SOLVED**2 * size
    for _ in range(STEPS_MOST):
        if (size <= wanted).all():
            break
        image = times(along)
        curvature = np.sum(along * image, axis=0)
        step = np.divide(size, curvature, out=np.zeros_like(size), where=curvature > 0.0)
        x, rest = x + step * along, rest - step * image
        steep = _divided(rest, diagonal)
        last, size = size, np.sum(rest * steep, axis=0)
        along = steep + along * np.divide(size, last, out=np.zeros_like(size), where=last > 0.0)
    return x


def start_surface(scan: FloatMap, noise_std: float) -> tuple[FloatMap, FloatMap]:
    """Prior of the start surface: (mean, variance) [m], [m^2], the variance infinite where it was not seen.

    A plane, if the scan is as even as its noise; else a rough plane whose roughness is normal (empirical Bayes).
    """
    plane, rough, known = _plane(scan, noise_std)
    if rough == 0.0:
        return plane, known
    seen, noise = np.isfinite(scan), noise_std**2
    gain = rough / (rough + noise)
    mean = np.where(seen, plane + gain * np.where(seen, scan - plane, 0.0), plane)
    return mean, np.where(seen, gain * noise, np.inf)


def _plane(scan: FloatMap, noise_std: float) -> tuple[FloatMap, float, FloatMap]:
    """Plane of a scan [m], variance of the surface about it [m^2], 0 if it is even, and variance of the plane [m^2]."""
    seen = np.isfinite(scan)
    i, j = np.indices(scan.shape)
    terms = np.stack([np.ones(scan.shape), i / scan.shape[0], j / scan.shape[1]], axis=-1)
    if np.count_nonzero(seen) <= terms.shape[-1]:
        return np.zeros(scan.shape), 0.0, np.full(scan.shape, np.inf)
    plane = terms @ np.linalg.lstsq(terms[seen], scan[seen], rcond=None)[0]
    freedom = np.count_nonzero(seen) - terms.shape[-1]
    noise = noise_std**2
    rough = float(np.sum((scan - plane)[seen] ** 2) / freedom) - noise
    if rough <= FLATNESS * noise * np.sqrt(2.0 / freedom):
        return plane, 0.0, np.full(scan.shape, noise * terms.shape[-1] / np.count_nonzero(seen))
    return plane, rough, np.zeros(scan.shape)


def _evened(squares: FloatMap, rates: NDArray[np.float64]) -> FloatMap:
    """The mean of the values wherever droplets reach: model errors are no smaller where droplets add little."""
    reached = (rates > 0.0).any(axis=(0, 1))
    return np.where(reached, squares[reached].mean() if reached.any() else 0.0, 0.0)
