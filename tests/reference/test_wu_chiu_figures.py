"""The figures that Wu and Chiu print (2024): which come out of the model, which out of their equation 17."""

from __future__ import annotations

import numpy as np
import pytest

from support.fmus.fmu_driver import Driver
from support.numpy import wu_chiu_numpy

GAINED_VOLUME = np.array([[1.65, 8.96, 3.93], [5.02, 63.46, 5.00], [2.34, 7.94, 1.71]]) / 100  # eq. 18
GAINED_AREA = np.array([[10.05, 21.07, 9.94], [0.0, np.nan, 0.0], [10.09, 18.59, 9.57]]) / 100  # the same
DIFFERENCES = np.array([[-1.50, -3.41, -1.55], [6.24, -1.03, 6.12], [-1.42, -3.77, -1.40]])  # eq. 19 [um]
NEIGHBOURS = np.array([[True, True, True], [True, False, True], [True, True, True]])


def differences_between_two_drops(cap_radius: float):
    """Equation 7 around a cell with a drop on either side, each as it lies on flat ground [um]."""
    pattern = np.zeros((9, 9), dtype=np.int32)
    pattern[4, 4] = 1
    with Driver("VolumeAreaDeposition").start({"cap_radius": cap_radius}) as fmu:
        height, area = fmu.print_layer(pattern), fmu.get("area")
    volumes, areas = (np.roll(grid, 1, 1) + np.roll(grid, -1, 1) for grid in (height * 1e6, area))
    found = wu_chiu_numpy.heights(volumes, np.minimum(areas, 1.0), c=1.0)
    return wu_chiu_numpy.differences(found[3:6, 3:6])


def test_drops_of_0_6_pitches_radius_give_equation_19() -> None:
    error = differences_between_two_drops(0.0) - DIFFERENCES
    assert np.sqrt(np.mean(error**2)) <= 0.18
    assert np.array_equal(differences_between_two_drops(0.0), differences_between_two_drops(0.6 * 90e-6))


@pytest.mark.parametrize("pitches", [1.5, 2.0])
def test_radius_that_the_text_names_misses_equation_19(pitches) -> None:
    error = differences_between_two_drops(pitches * 90e-6) - DIFFERENCES
    assert np.sqrt(np.mean(error**2)) > 2.0


@pytest.mark.parametrize(
    ("gained", "is_higher", "mean_of_ratios"),
    [
        (GAINED_VOLUME, True, 0.0081),
        (GAINED_VOLUME, False, -0.0187),
        (GAINED_AREA, True, 0.0),
        (GAINED_AREA, False, -0.0636),
    ],
)
def test_equation_17_over_the_printed_figures(gained, is_higher, mean_of_ratios) -> None:
    """The coefficients in (20), 0.0067 -0.0201 0 -0.0634, come from resampled groups of samples."""
    chosen = NEIGHBOURS & ((DIFFERENCES > 0) == is_higher)
    assert np.mean(gained[chosen] / DIFFERENCES[chosen]) == pytest.approx(mean_of_ratios, abs=5e-5)


def test_published_volumes_sum_to_one_drop() -> None:
    assert GAINED_VOLUME.sum() == pytest.approx(1.0, abs=1e-3)
