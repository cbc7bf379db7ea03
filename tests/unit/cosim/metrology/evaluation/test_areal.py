"""Areal parameters equal closed forms, do not depend on where and how a map lies, and count measured cells only."""

from __future__ import annotations

from math import pi, sin, sqrt, tan
from typing import Any

import numpy as np
import pytest

from inkloop.errors import HeightMapError
from inkloop.metrology.evaluation.definitions import DEFINITIONS, FOperation, Treatment, symbols
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.surface import Refusal, s_filtered
from inkloop.metrology.evaluation.table import found
from inkloop.metrology.height_map import HeightMap
from support.evaluated import (
    PERIOD,
    STEP,
    A,
    areal,
    check,
    check_same,
    map_of,
    number,
    reason,
    rough,
    texture,
    wave,
)

OPERATIONS = ("none", "plane", "form")


def test_a_sinusoid_has_its_closed_forms() -> None:
    """Sampled exactly: sum |sin| over a period of n is 2 cot(pi / n); neighbours differ by 2 sin(pi / n) cos(...)."""
    found = areal(map_of(wave()), f_operation="none")
    expected = {"Sa": 2.0 * A / (PERIOD * tan(pi / PERIOD)), "Sq": A / sqrt(2.0), "Sp": A, "Sv": A, "Sz": 2.0 * A}
    check(found, expected | {"Sku": 1.5})
    assert number(found, "Ssk") == pytest.approx(0.0, abs=1e-12)
    whole = areal(map_of(wave(2 * PERIOD + 1)), f_operation="none")  # whole periods of differences
    check(whole, {"Sdq": A / STEP * 2.0 * sin(pi / PERIOD) / sqrt(2.0)})


def test_a_tilted_plane_vanishes_by_the_plane_and_a_paraboloid_by_the_second_order() -> None:
    i, j = np.indices((12, 9))
    z = 0.3 * STEP * i - 0.4 * 2 * STEP * j
    tilted = areal(map_of(z, STEP, 2 * STEP), f_operation="none")
    check(tilted, {"Sdq": 0.5, "Sdr": sqrt(1.25) - 1.0})
    for operation in ("plane", "form"):
        flat = areal(map_of(z, STEP, 2 * STEP), f_operation=operation)
        check(flat, dict.fromkeys(("Sa", "Sq", "Sz", "Sk", "Spk", "Vvc", "Sdq"), 0.0))
        for symbol in ("Ssk", "Sku", "Sal", "Str", "Std"):
            assert "flat" in reason(flat, symbol)
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
    expected = {"Sa": 2.0 * A * spread, "Sq": A * sqrt(spread), "Sp": A * (1.0 - share), "Sv": A * share}
    expected |= {"Ssk": (1.0 - 2.0 * share) / sqrt(spread), "Sku": (1.0 - 3.0 * spread) / spread}
    check(found, expected, rel=1e-9, abs=1e-12)


def test_a_single_tip_has_the_area_of_its_pyramid() -> None:
    """Of height h on four squares: in each of them, half of the diagonals cut the tip off on two flanks of slope h."""
    z = np.zeros((9, 9))
    z[4, 4] = STEP
    found = areal(map_of(z), f_operation="none")
    triangles = [1.0, 2.0, 1.0, 0.0]  # |grad z|^2 of the four triangles of a square at the tip
    ratio = sum(sqrt(1 + g) - 1 for g in triangles) / 64
    check(found, {"Sdq": sqrt(sum(triangles) / 64), "Sdr": ratio})


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


def test_too_little_to_evaluate_is_refused() -> None:
    z, mask = rough((7, 10)), np.zeros((7, 10), bool)
    mask[:5] = True
    assert number(areal(map_of(z), mask), "Sa") > 0.0
    mask[0, 0] = False
    assert reason(areal(map_of(z), mask), "Sa") == "49 cells have a height; needs 50: take a larger mask or map"
    z[0] = z[1, :4] = np.nan  # 14 of 70 are a fifth
    assert number(areal(map_of(z)), "Sa") > 0.0
    z[1, 4] = np.nan
    assert reason(areal(map_of(z)), "Vmp").startswith("15 of 70 cells (21%) have no height; at most 20% may lack one")
    with pytest.raises(HeightMapError, match="mask"):
        areal(map_of(z), np.ones((3, 3), bool))
    assert "one line" in reason(areal(map_of(wave(60, 1))), "Sa")
    assert "no four neighbouring cells" in reason(areal(map_of(wave(60, 1)), f_operation="none"), "Sdq")


def test_treatment_is_told_for_each_group() -> None:
    plain, both = Treatment(), Treatment("form", 2.5e-6, 8e-5, 0)
    assert str(plain) == "taken off: least-squares plane; no filter"
    assert "S-filter 2.5 µm, L-filter 80 µm (Gaussian, regression order 0)" in str(both)
    assert both.of("areal") == str(both) != str(plain)
    assert both.of("form") == "nothing taken off; S-filter 2.5 µm (Gaussian, regression order 0)"
    assert both.of("volume") == "nothing taken off; no filter"
    assert plain.of("form") == "nothing taken off; no filter"


def test_s_filter_keeps_gaps_and_makes_no_edge_of_them() -> None:
    z = np.full((12, 12), 5e-6)
    z[4, 4] = np.nan
    found = s_filtered(map_of(z), Treatment(s_filter=5e-5))
    assert isinstance(found, HeightMap)
    assert np.argwhere(np.isnan(found.z)).tolist() == [[4, 4]]
    np.testing.assert_allclose(found.z[np.isfinite(found.z)], 5e-6, rtol=1e-9)
    assert found.source == "test"
    assert isinstance(s_filtered(map_of(z), Treatment(s_filter=1.0)), Refusal)
    same = map_of(z)
    assert s_filtered(same, Treatment()) is same


def test_surface_topography_agrees_on_rectangles() -> None:
    topography = pytest.importorskip("SurfaceTopography", reason="needs inkloop[metrology]").Topography
    # its gradients are those of one triangle a square, which does not matter where the map repeats itself
    z = np.pad(rough((40, 30)), ((0, 1), (0, 1)), mode="wrap")
    for f_operation, detrending in {"none": "center", "plane": "height", "form": "curvature"}.items():
        other = topography(z, physical_sizes=(41 * STEP, 31 * STEP), unit="m").detrend(detrending)
        found = areal(map_of(z), f_operation=f_operation)
        assert number(found, "Sq") == pytest.approx(other.rms_height_from_area(), rel=1e-6, abs=0.0)
        if f_operation != "form":
            assert number(found, "Sdq") == pytest.approx(other.rms_gradient(), rel=1e-9, abs=0.0)

    # its bearing area is that of planes between the cells, which does not matter where the surface is smooth
    smooth = texture((4.0, 4.0), (120, 100))
    smooth = smooth - smooth.mean()
    other = topography(smooth, physical_sizes=(120 * STEP, 100 * STEP), unit="m")
    heights = np.linspace(np.quantile(smooth, 0.9, method="hazen"), smooth.max(), 101)
    ratios = np.array([other.bearing_area(height) for height in heights])
    assert ratios[0] == pytest.approx(0.1, rel=0.02, abs=0.0)
    found = areal(map_of(smooth), f_operation="none")
    assert number(found, "Vmp") == pytest.approx(np.trapezoid(ratios, heights), rel=0.03, abs=0.0)
