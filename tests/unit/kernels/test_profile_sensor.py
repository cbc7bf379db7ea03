"""Invariants of the profile sensor, shown on the FMU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.fmus.fmu_driver import DISCARD, OK, Driver
from support.numpy import sensor_numpy

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


def test_sensor_without_errors_shows_the_surface() -> None:
    reading, valid = scans([ROUGH])[0]
    assert np.array_equal(reading, ROUGH)
    assert valid.all()


def test_halves_round_to_the_even_multiple() -> None:
    surface = np.array([[0.5, 1.5, 2.5, -0.5]])
    assert measured(surface, resolution=1.0).tolist() == [[0.0, 2.0, 2.0, 0.0]]


def test_white_noise_has_its_standard_deviation() -> None:
    noise = measured(np.zeros((60, 50)), noise_std=1e-6)
    assert noise.std() == pytest.approx(1e-6, rel=4 / np.sqrt(2 * 3000), abs=0.0)
    assert abs(noise.mean()) < 4e-6 / np.sqrt(3000)


def test_correlated_share_of_the_noise_is_common_to_a_scan() -> None:
    readings = np.array(
        [reading for reading, _ in scans([np.zeros((5, 4))] * 400, noise_std=1e-6, noise_correlation=0.25)]
    )
    within, between = readings.std(axis=(1, 2), ddof=1), readings.mean(axis=(1, 2))
    assert (within**2).mean() == pytest.approx(0.75e-12, rel=0.1, abs=0.0)
    assert between.var() == pytest.approx(0.25e-12 + 0.75e-12 / 20, rel=0.3, abs=0.0)
    assert np.ptp(measured(np.zeros((5, 4)), noise_std=1e-6, noise_correlation=1.0)) == 0.0


def test_spot_spreads_a_spike_with_its_standard_deviation() -> None:
    spike = np.zeros((33, 33))
    spike[16, 16] = 1.0
    averaged = measured(spike, spot_radius=2 * PITCH)
    distance = np.arange(33) - 16
    assert averaged.sum() == pytest.approx(1.0, rel=1e-9, abs=0.0)
    assert (averaged.sum(axis=0) * distance**2).sum() == pytest.approx(4.0, rel=0.01, abs=0.0)


def test_all_errors_together_in_the_order_of_the_hardware() -> None:
    parameters: dict[str, Any] = {
        "noise_std": 1e-6,
        "noise_correlation": 0.3,
        "resolution": 0.1e-6,
        "bias": 2e-6,
        "drift_rate": 0.5e-6,
        "tilt_x": 1e-3,
        "tilt_y": 2e-3,
        "shift_x": 60e-6,
        "shift_y": -400e-6,
        "shift_std": 20e-6,
        "spot_radius": 200e-6,
        "slope_bias": 3e-6,
        "dropout_slope": 0.02,
        "dropout_rate": 0.1,
        "seed": 11,
    }
    last = np.zeros(ROUGH.shape)
    surfaces = [ROUGH * (layer + 1) / 3 for layer in range(3)]
    for number, (reading, valid) in enumerate(scans(surfaces, **parameters)):
        expected, expected_valid = sensor_numpy.scan(surfaces[number], number, pitch=PITCH, **parameters)
        last = np.where(expected_valid, expected, last)
        assert np.array_equal(valid, expected_valid)
        assert reading == pytest.approx(last, rel=1e-12, abs=1e-18)
        assert 0.2 < valid.mean() < 0.95


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


def test_layers_printed_cannot_go_back() -> None:
    with Driver("ProfileSensor").start({"scan_duration": 0.0, "layers_printed": 3}) as fmu:
        assert fmu.step(0.0) == OK
        assert fmu.set("layers_printed", 2) == OK
        before = fmu.save()
        assert fmu.step(1.0) == DISCARD
        assert fmu.save() == before
        assert "can only rise" in fmu.messages[-1]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_height_that_is_not_finite_is_refused_whole(bad) -> None:
    with Driver("ProfileSensor", nx=3, ny=4).start({"height": 1e-6}) as fmu:
        surface = np.full((3, 4), 2e-6)
        surface[1, 2] = bad
        assert fmu.set("height", surface) == DISCARD
        assert (fmu.get("height") == 1e-6).all()
        assert "height of cell (1, 2) is" in fmu.messages[-1]
