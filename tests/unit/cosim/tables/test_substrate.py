"""The surface to print on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.scenario.file import Scenario
from inkloop.tables.shapes import SubstrateTable
from support.places import SCENARIOS

PITCH = 250e-6


def height(nx: int, ny: int, seed: int = 1, **keys: Any) -> np.ndarray:
    return SubstrateTable(**keys).height(nx, ny, PITCH, seed)


def test_tilt_step_and_wave_have_their_size_over_the_lowest_cell() -> None:
    assert height(7, 6, tilt_x=0.01, step_um=-30.0, wave_um=5.0, roughness_um=2.0).min() == 0.0
    tilted = height(5, 4, tilt_x=0.01, tilt_y=-0.02)
    np.testing.assert_allclose(np.diff(tilted, axis=0), 0.01 * PITCH)
    np.testing.assert_allclose(np.diff(tilted, axis=1), -0.02 * PITCH)
    np.testing.assert_allclose(height(6, 2, step_um=30.0)[:, 0], [0.0] * 3 + [30e-6] * 3, rtol=1e-12)
    wave = height(9, 5, wave_um=5.0, wavelength_um=7.3 * PITCH * 1e6)
    along_x, along_y = (np.cos(2.0 * np.pi * np.arange(-cells, cells + 1) / 7.3) for cells in (4, 2))
    np.testing.assert_allclose(wave - wave[4, 2], 5e-6 * (np.outer(along_x, along_y) - 1.0), rtol=0.0, atol=1e-17)


def test_roughness_has_its_standard_deviation_and_follows_the_seed() -> None:
    first, again, other = (height(60, 60, seed, roughness_um=2.0) for seed in (1, 1, 2))
    assert first.std() == pytest.approx(2e-6, rel=0.05, abs=0.0)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_print_starts_from_the_substrate_of_the_file() -> None:
    scenario = Scenario.load(SCENARIOS / "uneven-start.toml")
    expected = scenario.job().height_start
    assert expected is not None
    components = scenario.build()
    try:
        outputs = components["printer"].initialize(0, {p.name: p.start_value() for p in components["printer"].inputs})
    finally:
        for component in components.values():
            component.terminate()
    np.testing.assert_array_equal(outputs["height"], expected)
