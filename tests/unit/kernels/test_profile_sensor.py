"""Invariants of the profile sensor, shown on the FMU."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from support.fmus.fmu_driver import DISCARD, OK, Driver

PITCH = 263.256e-6
ROUGH = np.random.default_rng(5).uniform(0.0, 40e-6, (9, 7))


def scans(surfaces, **parameters):
    """(measured, valid) of one scan of each surface."""
    shape = np.shape(surfaces[0])
    found = []
    with Driver("ProfileSensor", nx=shape[0], ny=shape[1]).start({"scan_duration": 0.0, **parameters}) as fmu:
        for layer, surface in enumerate(surfaces):
            assert max(fmu.set("height", surface), fmu.set("layers_printed", layer)) == OK
            assert fmu.step(float(layer)) == OK
            assert fmu.get("layers_scanned") == layer
            found.append((fmu.get("measured_height"), fmu.get("valid")))
    return found


def measured(surface, **parameters):
    return scans([surface], **parameters)[0][0]


def test_readings_are_the_surface_or_the_nearest_multiple_of_the_resolution() -> None:
    reading, valid = scans([ROUGH])[0]
    assert np.array_equal(reading, ROUGH)
    assert valid.all()
    assert measured(ROUGH, resolution=0.1e-6) == pytest.approx(np.round(ROUGH * 1e7) * 1e-7, abs=1e-15)
    halves = np.array([[0.5, 1.5, 2.5, -0.5]])
    assert measured(halves, resolution=1.0).tolist() == [[0.0, 2.0, 2.0, 0.0]]


def test_spot_keeps_a_plane_inside_and_a_constant_everywhere() -> None:
    plane = np.add.outer(2e-6 * np.arange(15), -1e-6 * np.arange(15))
    averaged = measured(plane, spot_radius=PITCH)
    assert averaged[4:-4, 4:-4] == pytest.approx(plane[4:-4, 4:-4], abs=1e-18)
    assert measured(np.full((4, 6), 3e-6), spot_radius=2 * PITCH) == pytest.approx(3e-6, rel=1e-14, abs=0.0)


def test_spot_spreads_a_spike_with_its_standard_deviation() -> None:
    spike = np.zeros((33, 33))
    spike[16, 16] = 1.0
    averaged = measured(spike, spot_radius=2 * PITCH)
    distance = np.arange(33) - 16
    assert averaged.sum() == pytest.approx(1.0, rel=1e-9, abs=0.0)
    assert (averaged.sum(axis=0) * distance**2).sum() == pytest.approx(4.0, rel=0.01, abs=0.0)


@pytest.mark.parametrize("shape", [(9, 5), (5, 9)])
@pytest.mark.parametrize("x", [-20.0, -1.0, 0.25, 3.0])
@pytest.mark.parametrize("y", [-2.0, -0.75, 1.5, 20.0])
def test_shifted_sensor_reads_the_surface_beyond_each_cell(shape: tuple[int, int], x: float, y: float) -> None:
    """Linear between cells; beyond the border the surface is as high as there."""
    surface = np.random.default_rng(5).uniform(10e-6, 40e-6, shape)
    places = np.indices(shape) + np.array([x, y])[:, None, None]
    expected = map_coordinates(surface, places, order=1, mode="nearest")
    assert measured(surface, shift_x=x * PITCH, shift_y=y * PITCH) == pytest.approx(expected, rel=1e-12, abs=0.0)


def test_scan_takes_the_surface_of_its_beginning() -> None:
    with Driver("ProfileSensor").start({"scan_duration": 3.0, "height": 1e-6}) as fmu:
        assert fmu.step(0.0) == OK
        assert (fmu.get("status"), fmu.get("layers_scanned")) == (1, -1)
        assert max(fmu.set("height", 2e-6), fmu.set("layers_printed", 4)) == OK
        assert max(fmu.step(1.0), fmu.step(2.0)) == OK
        assert (fmu.get("status"), fmu.get("layers_scanned")) == (0, 0)
        assert (fmu.get("measured_height") == 1e-6).all()
        assert fmu.step(3.0, 100.0) == OK
        assert fmu.get("layers_scanned") == 4
        assert (fmu.get("measured_height") == 2e-6).all()


def test_scan_ends_after_its_duration_but_for_the_rounding_of_times() -> None:
    """Eight steps of 0.1 s end at 0.7999999999999999 s."""
    with Driver("ProfileSensor").start({"scan_duration": 0.8}) as fmu:
        scanned = []
        for _ in range(8):
            assert fmu.step(fmu.now, 0.1) == OK
            scanned.append(int(fmu.get("layers_scanned")))
        assert fmu.now < 0.8
        assert scanned == [-1] * 7 + [0]


@pytest.mark.parametrize(("limit", "is_valid"), [(0.5, True), (0.4999, False)])
@pytest.mark.parametrize("axis", [0, 1])
def test_cells_steeper_than_the_limit_are_lost_and_as_steep_ones_are_not(axis: int, limit: float, is_valid) -> None:
    plane = 0.5 * np.indices((4, 3))[axis]
    ((_, valid),) = scans([plane], pitch=1.0, dropout_slope=limit)
    assert (valid == is_valid).all()


def test_layers_printed_cannot_go_back() -> None:
    with Driver("ProfileSensor").start({"scan_duration": 0.0, "layers_printed": 3}) as fmu:
        assert fmu.step(0.0) == OK
        assert fmu.set("layers_printed", 2) == OK
        before = fmu.save()
        assert fmu.step(1.0) == DISCARD
        assert fmu.save() == before
        assert "layers_printed is 2, but layer 3 has been scanned already; it can only rise" in fmu.messages[-1]
