"""The surface to print on."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop.scenario.file import Scenario
from inkloop.tables.substrate import Substrate
from support.places import SCENARIOS

PITCH = 250e-6
UNEVEN = SCENARIOS / "uneven-start.toml"


@pytest.mark.parametrize("substrate", [Substrate(), Substrate(tilt_x=0.01, step=-30e-6, wave=5e-6, roughness=2e-6)])
def test_lowest_cell_is_the_zero_of_the_substrate(substrate: Substrate) -> None:
    assert substrate.height(7, 6, PITCH, 1).min() == 0.0


def test_tilt_is_a_slope_per_length() -> None:
    height = Substrate(tilt_x=0.01, tilt_y=-0.02).height(5, 4, PITCH, 1)
    np.testing.assert_allclose(np.diff(height, axis=0), 0.01 * PITCH)
    np.testing.assert_allclose(np.diff(height, axis=1), -0.02 * PITCH)


def test_step_parts_the_grid_in_the_middle() -> None:
    height = Substrate(step=30e-6).height(6, 2, PITCH, 1)
    np.testing.assert_array_equal(height[:, 0], [0.0] * 3 + [30e-6] * 3)


def test_wave_has_a_crest_in_the_middle_of_the_grid() -> None:
    height = Substrate(wave=5e-6, wavelength=7.3 * PITCH).height(9, 5, PITCH, 1)
    along_x, along_y = (np.cos(2.0 * np.pi * np.arange(-cells, cells + 1) / 7.3) for cells in (4, 2))
    np.testing.assert_allclose(height - height[4, 2], 5e-6 * (np.outer(along_x, along_y) - 1.0), rtol=0.0, atol=1e-18)


def test_roughness_has_its_standard_deviation_and_follows_the_seed() -> None:
    first, again, other = (Substrate(roughness=2e-6).height(60, 60, PITCH, seed) for seed in (1, 1, 2))
    assert first.std() == pytest.approx(2e-6, rel=0.05, abs=0.0)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_print_starts_from_the_substrate_of_the_file() -> None:
    scenario = Scenario.load(UNEVEN)
    expected = scenario.job().height_start
    assert expected is not None
    components = scenario.build()
    try:
        outputs = components["printer"].initialize(0, {p.name: p.start_value() for p in components["printer"].inputs})
    finally:
        for component in components.values():
            component.terminate()
    np.testing.assert_array_equal(outputs["height"], expected)
