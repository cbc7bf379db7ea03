"""The filter over the scans of a print by hand: what a scan is compared with, how uncertain, and where it counts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop_lab.identify.expected_increments import expected_rates, expected_share
from inkloop_lab.identify.print_record import PrintRecord
from inkloop_lab.identify.scan_geometry import ScanGeometry
from inkloop_lab.identify.surface_filter import UNSEEN, first_surface, innovations, start_surface

INK = np.array([[4e-6, 1e-6, 0.5e-6]])
FAR = np.array([[4e-6, 1e-6, 0.5e-6, 0.2e-6, 0.1e-6, 0.1e-6]])
SHAPE = (11, 9)


def print_of(scans: Any, *cells: tuple[int, int]) -> PrintRecord:
    """One droplet on each of these cells in each layer."""
    measured = np.asarray(scans, np.float64)
    pattern = np.zeros((len(measured) - 1, *measured.shape[1:]), np.int32)
    for cell in cells:
        pattern[:, cell[0], cell[1]] = 1
    return PrintRecord("it", 1e-4, pattern, measured)


def in_register(record: PrintRecord) -> ScanGeometry:
    return ScanGeometry.in_register(record.shape, len(record.pattern))


def shifted(record: PrintRecord, x: float, y: float) -> ScanGeometry:
    return in_register(record).moved(np.array([x, y, 0, 0, 0, 0, 0, 0]))


def test_height_of_an_even_plane_is_as_uncertain_as_the_mean_of_its_cells() -> None:
    """On average over the cells, a fit of three terms to n readings has 3 / n of their variance."""
    i, j = np.indices(SHAPE)
    mean, variance = start_surface(2e-6 * i - 1e-6 * j, 0.5e-6)
    np.testing.assert_allclose(mean, 2e-6 * i - 1e-6 * j, rtol=0.0, atol=1e-18)
    np.testing.assert_allclose(variance, 3.0 * 0.25e-12 / 99, rtol=1e-12)


@pytest.mark.parametrize(("excess", "is_even"), [(0.98, True), (1.02, False)])
def test_scan_is_even_within_two_standard_deviations_of_its_variance(excess: float, is_even: bool) -> None:
    """The variance of 99 cells about a plane has 96 degrees of freedom, and a relative deviation of sqrt(2 / 96)."""
    i, j = np.indices(SHAPE)
    terms = np.stack([np.ones(99), i.ravel(), j.ravel()], axis=1)
    wave = np.random.default_rng(1).normal(size=99)
    wave -= terms @ np.linalg.lstsq(terms, wave, rcond=None)[0]
    wanted = 96 * 1e-12 * (1.0 + 2.0 * excess * np.sqrt(2.0 / 96))
    scan = (wave * np.sqrt(wanted / (wave @ wave))).reshape(SHAPE)
    mean, _ = start_surface(scan, 1e-6)
    assert (np.abs(mean).max() < 1e-12) == is_even


@pytest.mark.parametrize(("count", "known"), [(3, False), (4, True)])
def test_plane_needs_a_reading_more_than_it_has_terms(count: int, known: bool) -> None:
    scan = np.full((3, 3), np.nan)
    scan.ravel()[[0, 1, 3, 8][:count]] = 1e-6
    mean, variance = start_surface(scan, 1e-7)
    np.testing.assert_allclose(mean, 1e-6 if known else 0.0, rtol=1e-9, atol=1e-18)
    assert np.isfinite(variance).all() == known


def test_displaced_start_surface_is_unknown_where_no_reading_lies_near() -> None:
    scan = np.random.default_rng(2).normal(0.0, 3e-6, SHAPE)
    scan[4:, :] = np.nan
    _, variance = first_surface(scan, 0.1e-6, shifted(print_of([scan, scan]), 0.25, 0.0))
    assert (variance[5:] == UNSEEN).all()  # row 4 is read by a quarter of that of row 3
    assert (variance[:4] < 0.1e-12).all()


@pytest.mark.parametrize(("heights", "reach"), [(INK, 1), (FAR, 2)])
@pytest.mark.parametrize("correct", [True, False])
def test_readings_within_reach_of_an_unknown_cell_do_not_count(heights: Any, reach: int, correct: bool) -> None:
    """Droplets on the cells between may have left more or less there."""
    scans = np.random.default_rng(3).normal(0.0, 3e-6, (2, *SHAPE))
    scans[0, 5, 4] = scans[1, 0, 0] = np.nan
    record = print_of(scans, (2, 2))
    (step,) = innovations(record, heights, 0.1e-6, 0.01, in_register(record), correct=correct)
    expected = np.ones(SHAPE, np.bool_)
    expected[5 - reach : 6 + reach, 4 - reach : 5 + reach] = expected[0, 0] = False
    np.testing.assert_array_equal(step.usable, expected)


def test_reading_between_cells_counts_where_none_of_them_is_near_an_unknown_one() -> None:
    scans = np.random.default_rng(3).normal(0.0, 3e-6, (2, *SHAPE))
    scans[0, 5, 4] = np.nan
    record = print_of(scans, (2, 2))
    (step,) = innovations(record, INK, 0.1e-6, 0.01, shifted(record, 0.0, 1.25))
    first = first_surface(scans[0], 0.1e-6, shifted(record, 0.0, 1.25))[1]
    unknown = first > 0.5 * UNSEEN
    near = np.zeros(SHAPE, np.bool_)
    for i, j in np.argwhere(unknown):
        near[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = True
    right, beyond = (np.minimum(np.arange(9) + step_, 8) for step_ in (1, 2))
    np.testing.assert_array_equal(step.usable, ~(near[:, right] | near[:, beyond]))


def test_increments_of_all_cells_that_droplets_reach_are_as_uncertain() -> None:
    """On a flat surface a droplet adds its three heights to nine cells; the mean of their squares counts in each."""
    record = print_of(np.zeros((2, *SHAPE)), (3, 2))
    (step,) = innovations(record, INK, 0.0, 0.25, in_register(record))
    expected = np.zeros(SHAPE)
    expected[2:5, 1:4] = (16.0 + 4.0 * 1.0 + 4.0 * 0.25) * 1e-12 / 9.0
    np.testing.assert_allclose(step.squares.reshape(SHAPE), expected, rtol=1e-9, atol=1e-24)
    np.testing.assert_allclose(step.variance.reshape(SHAPE), 0.25 * expected, rtol=1e-9, atol=1e-24)
    (noisy,) = innovations(record, INK, 0.2e-6, 0.25, in_register(record))
    plane = 3.0 * 0.04e-12 / 99  # of the surface before, beside the noise of the reading
    np.testing.assert_allclose(noisy.variance.reshape(SHAPE)[6:], plane + 0.04e-12, rtol=1e-9)


def test_place_of_a_displaced_reading_adds_to_its_variance_what_the_slope_makes_of_it() -> None:
    i, j = np.indices(SHAPE)
    record = print_of(np.stack([3e-6 * i + 4e-6 * j] * 2), (3, 2))
    geometry = shifted(record, 0.25, -0.5)
    steps = [next(innovations(record, INK, 0.2e-6, 0.0, geometry, place)) for place in (0.0, 0.01)]
    inner = np.zeros(SHAPE, np.bool_)
    inner[7:-2, 2:-2] = True  # apart from the droplet and from the border
    own = inner.ravel()[steps[0].usable.ravel()]
    np.testing.assert_allclose(steps[0].steepness[own], 25e-12, rtol=1e-9)
    np.testing.assert_allclose((steps[1].variance - steps[0].variance)[own], 0.01 * 25e-12, rtol=1e-9)


def test_prediction_from_scans_as_they_are_leaves_out_what_the_filter_knows() -> None:
    """The second scan is 1 um too high: plain predictions follow it, those of the filter by some of it only."""
    scans = np.zeros((3, *SHAPE))
    scans[1] = 1e-6
    record = replace(print_of(scans), pattern=np.zeros((2, *SHAPE), np.int32))
    plain, filtered = (
        list(innovations(record, INK, 0.5e-6, 0.0, in_register(record), correct=correct))[1].error
        for correct in (False, True)
    )
    np.testing.assert_allclose(plain, -1e-6, rtol=1e-9)
    gain = (3.0 / 99) / (3.0 / 99 + 1.0)  # of a plane that is known to 3 / 99 of the variance of a reading
    np.testing.assert_allclose(filtered, -gain * 1e-6, rtol=1e-9)


def test_squares_of_increments_are_those_of_each_droplet_alone() -> None:
    """A side 2.5 um higher takes s = 1 - 2.5 / 5 of h2, the droplet keeps the rest; two droplets add their squares."""
    height, pattern = np.zeros((5, 5)), np.zeros((5, 5), np.int32)
    height[1, 2], pattern[2, 2] = 2.5e-6, 1
    _, squares = expected_rates(height, np.zeros((5, 5)), pattern, INK)
    assert squares[1, 2] == pytest.approx(0.25e-12, rel=1e-9, abs=0.0)
    assert squares[2, 2] == pytest.approx(4.5e-6**2, rel=1e-9, abs=0.0)
    assert squares[3, 2] == pytest.approx(1e-12, rel=1e-9, abs=0.0)
    height[1, 2], pattern[2, 3] = 0.0, 1
    _, both = expected_rates(height, np.zeros((5, 5)), pattern, INK)
    assert both[2, 2] == pytest.approx(16e-12 + 1e-12, rel=1e-9, abs=0.0)
    _, of_passes = expected_rates(height, np.zeros((5, 5)), pattern, INK, (3, 2, 1, 0))
    assert of_passes[1, 4] == pytest.approx(0.25e-12, rel=1e-9, abs=0.0)
    assert of_passes[3, 1] == pytest.approx(0.25e-12, rel=1e-9, abs=0.0)


def test_share_is_uncertain_by_both_cells() -> None:
    height, variance, pattern = np.zeros((5, 5)), np.full((5, 5), 1e-12), np.zeros((5, 5), np.int32)
    variance[1, 2], height[1, 2], pattern[2, 2] = 8e-12, 1e-6, 1
    rates, _ = expected_rates(height, variance, pattern, INK)
    of_side = expected_share(np.array([-1e-6]), np.array([9e-12]), np.array([5e-6]))[0]
    of_other = expected_share(np.array([0.0]), np.array([2e-12]), np.array([5e-6]))[0]
    assert rates[0, 1, 1, 2] == pytest.approx(of_side, rel=1e-9, abs=0.0)
    assert rates[0, 1, 3, 2] == pytest.approx(of_other, rel=1e-9, abs=0.0)
    assert rates[0, 1, 2, 2] == pytest.approx(4.0 - of_side - 3.0 * of_other, rel=1e-9, abs=0.0)
