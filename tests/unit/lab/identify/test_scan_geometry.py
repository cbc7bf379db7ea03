"""Places of displaced readings, against the profiler of the rig; x and y differ in everything."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop_lab.identify.scan_geometry import PRIOR_STD, TERMS, GeometryFit, ScanGeometry
from support.lying_scans.profiler import Profiler, displaced

SHAPES = [(9, 14), (14, 9)]


def geometry_of(shape: tuple[int, int], layers: int, **faults: float) -> ScanGeometry:
    """The terms by their definition: what is added to a place at the grid's edges [cells]."""
    turn, size, shear = (
        np.deg2rad(faults.get("rotation", 0.0)),
        1.0 + faults.get("magnification", 0.0),
        faults.get("shear", 0.0),
    )
    (a, b), (c, d) = (
        size * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [[1.0, shear], [0.0, 1.0]]
    )
    x, y = ((count - 1) / 2 for count in shape)
    linear = [(a - 1) * x, b * y, c * x, (d - 1) * y]
    return ScanGeometry(shape, layers, np.array([faults.get("x", 0.0), faults.get("y", 0.0), *linear, 0.0, 0.0]))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "faults",
    [{"x": 0.25}, {"y": -0.25}, {"x": -1.6, "y": 0.4}, {"rotation": 3.0}, {"rotation": -3.0}, {"magnification": 0.03},
     {"magnification": -0.03}, {"shear": 0.05},
     {"x": 0.3, "y": -0.2, "rotation": 2.0, "magnification": 0.02, "shear": -0.02}],
)  # fmt: skip
def test_scan_reads_what_the_profiler_of_the_rig_reads(shape: tuple[int, int], faults: dict[str, float]) -> None:
    surface = np.random.default_rng(1).random(shape)
    about = {key: value for key, value in faults.items() if key not in "xy"}
    profiler = Profiler(shift=(faults.get("x", 0.0), faults.get("y", 0.0)), **about)  # type: ignore[arg-type]
    expected = displaced(profiler, surface, 0.0, np.random.default_rng(0))
    found = geometry_of(shape, 4, **faults).sampling(2) @ surface.ravel()
    np.testing.assert_allclose(found, expected.ravel(), rtol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_linear_part_is_as_uncertain_before_the_scans_on_any_grid(shape: tuple[int, int]) -> None:
    deviations = ScanGeometry.in_register(shape, 4).prior_precision ** -0.5
    np.testing.assert_allclose(ScanGeometry(shape, 4, deviations).linear, PRIOR_STD[1], rtol=1e-12)


def test_scans_in_register_are_read_as_they_are() -> None:
    surface = np.random.default_rng(1).random((5, 4))
    none = ScanGeometry.in_register((5, 4), 3)
    assert none.is_none
    assert np.array_equal(none.sampling(1) @ surface.ravel(), surface.ravel())
    assert none.describe() == "lie in register"


def test_drift_runs_from_the_first_layer_to_the_last_one() -> None:
    terms = np.array([0.1, -0.3, 0, 0, 0, 0, 0.2, 0.5])
    cells = np.indices((4, 6)).reshape(2, -1)
    for scan, expected in ((0, (-0.1, -0.8)), (1, (-0.1, -0.8)), (3, (0.1, -0.3)), (5, (0.3, 0.2))):
        moved = ScanGeometry((4, 6), 5, terms).places(scan) - cells
        np.testing.assert_allclose(moved, np.array(expected)[:, None] * np.ones(24), atol=1e-12)
    single = ScanGeometry((4, 6), 1, terms).places(1) - cells
    np.testing.assert_allclose(single[:, 0], [0.1, -0.3], atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("term", range(TERMS))
def test_sensitivity_is_the_change_of_the_readings_of_an_even_slope(shape: tuple[int, int], term: int) -> None:
    i, j = np.indices(shape)
    slope: Any = 3.0 * i - 2.0 * j
    here = geometry_of(shape, 4, x=0.1, rotation=1.0)
    moved = here.moved(1e-3 * np.eye(TERMS)[term])
    change = (moved.sampling(4) - here.sampling(4)) @ slope.ravel() / 1e-3
    found = here.sensitivity(4, here.slopes(4, slope))[term]
    inside = np.zeros(shape, np.bool_)
    inside[2:-2, 2:-2] = True
    np.testing.assert_allclose(found[inside.ravel()], change[inside.ravel()], rtol=1e-6, atol=1e-9)


def test_description_has_the_figures_of_the_profiler() -> None:
    text = geometry_of((9, 14), 4, x=0.25, y=-0.1, rotation=1.5, magnification=0.02).describe()
    assert text.startswith("lie +0.25 cells along x and -0.10 along y")
    assert "rotated by +1.53 degrees" in text  # times the magnification
    assert "magnified by +2.0 %" in text
    assert geometry_of((9, 14), 4, shear=0.03).describe().endswith("sheared by +3.0 %")
    drifting = ScanGeometry((9, 14), 4, np.array([0, 0, 0, 0, 0, 0, -0.15, 0.25]))
    assert "drift by -0.30 and +0.50" in drifting.describe()


def test_farthest_reading_is_at_a_corner() -> None:
    assert geometry_of((9, 14), 4, magnification=0.1).farthest == pytest.approx(
        0.1 * np.hypot(4.0, 6.5), rel=1e-12, abs=0.0
    )
    drifting = ScanGeometry((9, 14), 4, np.array([0.3, 0, 0, 0, 0, 0, -0.5, 0]))
    assert drifting.farthest == pytest.approx(0.8, rel=1e-12, abs=0.0)
    to_the_end = ScanGeometry((9, 14), 4, np.array([0.3, 0, 0, 0, 0, 0, 0.6, 0]))
    assert to_the_end.farthest == pytest.approx(0.9, rel=1e-12, abs=0.0)


def test_step_finds_the_terms_of_a_linear_law_and_is_not_too_long() -> None:
    rng, true = np.random.default_rng(4), 0.1 * np.arange(-4, 4)
    sensitivity = 1e6 * rng.standard_normal((TERMS, 200))
    fit = GeometryFit.of(ScanGeometry.in_register((9, 14), 4), sensitivity, np.ones(200))
    np.testing.assert_allclose(fit.step(true @ sensitivity), true, atol=1e-6)
    assert np.abs(fit.step(10.0 * true @ sensitivity)).max() == pytest.approx(0.5, rel=1e-9, abs=0.0)


def test_step_weighs_the_present_terms_against_what_is_likely() -> None:
    """Scans that tell nothing pull the terms back to none; a line of one cell has no linear part across it."""
    terms = 0.01 * np.arange(1.0, 9.0)
    fit = GeometryFit.of(ScanGeometry((9, 14), 4, terms), np.zeros((TERMS, 5)), np.ones(5))
    np.testing.assert_allclose(fit.step(np.ones(5)), -terms, rtol=1e-9)
    line = ScanGeometry((1, 5), 3, np.array([0, 0, 0.5, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(line.places(1), np.indices((1, 5)).reshape(2, -1))
