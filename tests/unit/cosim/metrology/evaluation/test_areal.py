"""Areal parameters equal closed forms, do not depend on where and how a map lies, and count measured cells only."""

from __future__ import annotations

from math import pi, sin, sqrt, tan
from typing import Any

import numpy as np
import pytest

from inkloop.errors import HeightMapError
from inkloop.metrology.evaluation.definitions import DEFINITIONS, FOperation, Treatment, symbols
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.table import found
from support.evaluated import PERIOD, STEP, A, areal, check_same, map_of, number, reason, rough, surface_of, wave

OPERATIONS = ("none", "plane", "form")


def test_a_sinusoid_has_its_closed_forms() -> None:
    """Sampled exactly: sum |sin| over a period of n is 2 cot(pi / n); neighbours differ by 2 sin(pi / n) cos(...)."""
    found = areal(map_of(wave()), f_operation="none")
    expected = {"Sa": 2.0 * A / (PERIOD * tan(pi / PERIOD)), "Sq": A / sqrt(2.0), "Sp": A, "Sv": A, "Sz": 2.0 * A}
    for symbol, value in (expected | {"Sku": 1.5}).items():
        assert number(found, symbol) == pytest.approx(value, rel=1e-12, abs=0.0), symbol
    assert number(found, "Ssk") == pytest.approx(0.0, abs=1e-12)
    whole = areal(map_of(wave(2 * PERIOD + 1)), f_operation="none")  # whole periods of differences
    slope = A / STEP * 2.0 * sin(pi / PERIOD) / sqrt(2.0)
    assert number(whole, "Sdq") == pytest.approx(slope, rel=1e-12, abs=0.0)


def test_gradients_converge_to_those_of_the_smooth_sinusoid() -> None:
    """Sdq = 2 pi A / (sqrt(2) length); Sdr is the mean of sqrt(1 + z'^2) - 1, integrated here."""
    amplitude, length, cells = 5e-5, 4e-4, 400
    x = np.arange(cells + 1) * length / cells
    z = np.repeat(amplitude * np.sin(2 * pi * x / length)[:, None], 3, axis=1)
    found = areal(map_of(z, length / cells, 1e-3), f_operation="none")
    slope = 2 * pi * amplitude / length
    fine = np.linspace(0.0, 2 * pi, 100_000, endpoint=False)
    assert number(found, "Sdq") == pytest.approx(slope / sqrt(2.0), rel=1e-4, abs=0.0)
    ratio = np.mean(np.sqrt(1 + (slope * np.cos(fine)) ** 2) - 1)
    assert number(found, "Sdr") == pytest.approx(ratio, rel=1e-4, abs=0.0)


def test_a_tilted_plane_is_its_slope_and_vanishes_by_the_plane() -> None:
    i, j = np.indices((12, 9))
    z = 0.3 * STEP * i - 0.4 * 2 * STEP * j
    tilted = areal(map_of(z, STEP, 2 * STEP), f_operation="none")
    assert number(tilted, "Sdq") == pytest.approx(0.5, rel=1e-12, abs=0.0)
    assert number(tilted, "Sdr") == pytest.approx(sqrt(1.25) - 1.0, rel=1e-12, abs=0.0)
    for operation in ("plane", "form"):
        flat = areal(map_of(z, STEP, 2 * STEP), f_operation=operation)
        assert [number(flat, symbol) for symbol in ("Sa", "Sq", "Sz", "Sk", "Spk", "Vvc", "Sdq")] == [0.0] * 7
        for symbol in ("Ssk", "Sku", "Sal", "Str", "Std"):
            assert "flat" in reason(flat, symbol)


def test_a_paraboloid_vanishes_by_the_second_order() -> None:
    i, j = np.indices((12, 9))
    z = 1e-9 * (3.0 * i * i - 2.0 * i * j + j * j + 7.0 * j)
    assert number(areal(map_of(z), f_operation="form"), "Sz") == 0.0
    assert number(areal(map_of(z), f_operation="plane"), "Sz") > 1e-8


def test_the_target_is_taken_off() -> None:
    target = wave() * 3.0
    rest = rough(target.shape)
    mine = areal(map_of(rest), f_operation="none")
    subject = Subject(map_of(rest + target), target=target)
    check_same(found(subject, "areal", Treatment("target")), mine, rel=1e-8)
    assert "knows no target" in reason(areal(map_of(rest), f_operation="target"), "Sa")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.7])
def test_two_levels_have_their_closed_forms(share: float) -> None:
    """A share q of the cells one step h higher."""
    z = np.zeros((10, 10))
    z.flat[: round(share * 100)] = A
    found, spread = areal(map_of(z), f_operation="none"), share * (1.0 - share)
    assert number(found, "Sa") == pytest.approx(2.0 * A * spread, rel=1e-12, abs=0.0)
    assert number(found, "Sq") == pytest.approx(A * sqrt(spread), rel=1e-12, abs=0.0)
    assert number(found, "Sp") == pytest.approx(A * (1.0 - share), rel=1e-12, abs=0.0)
    assert number(found, "Sv") == pytest.approx(A * share, rel=1e-12, abs=0.0)
    assert number(found, "Ssk") == pytest.approx((1.0 - 2.0 * share) / sqrt(spread), rel=1e-9, abs=1e-12)
    assert number(found, "Sku") == pytest.approx((1.0 - 3.0 * spread) / spread, rel=1e-9, abs=0.0)


def test_a_single_tip_has_the_area_of_its_pyramid() -> None:
    """Of height h on four squares: in each of them, half of the diagonals cut the tip off on two flanks of slope h."""
    z = np.zeros((9, 9))
    z[4, 4] = STEP
    found = areal(map_of(z), f_operation="none")
    triangles = [1.0, 2.0, 1.0, 0.0]  # |grad z|^2 of the four triangles of a square at the tip
    assert number(found, "Sdq") == pytest.approx(sqrt(4 * sum(triangles) / 4 / 64), rel=1e-12, abs=0.0)
    ratio = 4 * sum(sqrt(1 + g) - 1 for g in triangles) / 4 / 64
    assert number(found, "Sdr") == pytest.approx(ratio, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("filters", [{}, {"s_filter": 13e-5, "l_filter": 30e-5}])
@pytest.mark.parametrize("f_operation", OPERATIONS)
def test_offset_mirror_and_quarter_turn_change_nothing(f_operation: FOperation, filters: dict[str, Any]) -> None:
    """But the direction of the lay, which mirrors and turns with the map."""
    z = rough()
    z[3, 5] = np.nan
    reference = areal(map_of(z, 2e-5, 3e-5), f_operation=f_operation, **filters)
    without = {symbol: value for symbol, value in reference.items() if symbol != "Std"}
    others = [(other, 2e-5, 3e-5) for other in (z + 1e-4, z[::-1], z[:, ::-1])]
    for other in (*others, (np.rot90(z), 3e-5, 2e-5)):
        found = areal(map_of(*other), f_operation=f_operation, **filters)
        check_same({symbol: found[symbol] for symbol in without}, without, rel=1e-7)


def test_lengths_scale_and_ratios_stay() -> None:
    """In another unit of length in all three directions."""
    one, other = areal(map_of(rough())), areal(map_of(rough() * 1e3, STEP * 1e3, STEP * 1e3))
    check_same(other, one, {symbol: 1e3 for symbol in one if DEFINITIONS[symbol].unit == "m"})
    assert set(one) == set(symbols("areal"))


@pytest.mark.parametrize("filters", [{}, {"s_filter": 5e-5, "l_filter": 9e-5, "filter_order": 0}, {"l_filter": 8e-5}])
@pytest.mark.parametrize("f_operation", OPERATIONS)
def test_a_mask_is_the_same_cells_cut_out(f_operation: FOperation, filters: dict[str, Any]) -> None:
    """And cells without a height are the same as cells outside the mask."""
    z, mask = rough(), np.zeros((24, 17), bool)
    mask[4:15, 3:12] = True
    cut = areal(map_of(z[4:15, 3:12]), f_operation=f_operation, **filters)
    check_same(areal(map_of(z), mask, f_operation=f_operation, **filters), cut, rel=1e-7)
    apart = areal(map_of(np.where(mask, z, np.nan)), mask, f_operation=f_operation, **filters)
    check_same(apart, cut, rel=1e-7)


def test_cells_without_a_height_are_left_out() -> None:
    z = rough()
    holes = np.random.default_rng(4).random(z.shape) < 0.1
    surface = surface_of(map_of(np.where(holes, np.nan, z)), f_operation="none")
    heights = z[~holes] - z[~holes].mean()
    assert np.array_equal(surface.used, ~holes)
    found = areal(map_of(np.where(holes, np.nan, z)), f_operation="none")
    assert number(found, "Sq") == pytest.approx(heights.std(), rel=1e-12, abs=0.0)
    assert number(found, "Sp") == pytest.approx(heights.max(), rel=1e-12, abs=0.0)
    assert number(found, "Sv") == pytest.approx(-heights.min(), rel=1e-12, abs=0.0)


def test_too_little_to_evaluate_is_refused() -> None:
    z = rough()
    assert "49 cells have a height; needs 50" in reason(areal(map_of(z[:7, :7])), "Sa")
    holes = np.where(np.arange(17) % 4 == 0, np.nan, z)
    assert "of 408 cells have no height; at most 20% may lack one" in reason(areal(map_of(holes)), "Vmp")
    with pytest.raises(HeightMapError, match="mask"):
        areal(map_of(z), np.ones((3, 3), bool))
    assert "one line" in reason(areal(map_of(wave(60, 1))), "Sa")
    assert "no four neighbouring cells" in reason(areal(map_of(wave(60, 1)), f_operation="none"), "Sdq")
