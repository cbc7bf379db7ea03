"""Gaussian filters on masked maps equal their definition, halve a wave as long as the cutoff, and keep planes."""

from __future__ import annotations

from math import log, pi, sqrt

import numpy as np
import pytest

from inkloop.metrology.evaluation.definitions import Axis, FilterOrder, Treatment
from inkloop.metrology.evaluation.filters import cutoff_error, gaussian
from inkloop.metrology.evaluation.surface import s_filtered
from inkloop.metrology.height_map import HeightMap
from support.evaluated import STEP, A, Map, areal, map_of, number, reason, rough, surface_of, wave

HOLES = np.random.default_rng(5).random((24, 17)) > 0.15


def by_definition(
    z: Map, used: Map, steps: tuple[float, float], cutoff: float, order: int, reach: tuple[int, int]
) -> Map:
    """Each cell by a weighted least-squares fit to the used cells within one cutoff; reach: 0 along an unused axis."""
    found = np.zeros_like(z)
    places = np.argwhere(used)
    alpha = sqrt(log(2) / pi)
    for i, j in places:
        lag = (places - (i, j)) * steps
        near = np.all(np.abs(lag) <= np.multiply(reach, cutoff * (1 + 1e-9)), axis=1)
        lag, heights = lag[near], z[used][near]
        weights = np.sqrt(np.exp(-pi * ((lag / (alpha * cutoff)) ** 2).sum(axis=1)))
        terms = np.column_stack([np.ones(len(lag)), *([lag[:, k] / cutoff for k in (0, 1)] if order else [])])
        found[i, j] = np.linalg.lstsq(terms * weights[:, None], heights * weights, rcond=None)[0][0]
    return found


@pytest.mark.parametrize("axis", [None, "x", "y"])
@pytest.mark.parametrize("order", [0, 1])
def test_every_cell_is_a_local_weighted_fit(order: FilterOrder, axis: Axis | None) -> None:
    z, steps, cutoff = rough() + 1e-3, (STEP, 2 * STEP), 10 * STEP
    found = gaussian(np.where(HOLES, z, 0.0), HOLES, steps, cutoff, order=order, axis=axis)
    reach = (int(axis != "y"), int(axis != "x"))
    expected = by_definition(z, HOLES, steps, cutoff, order, reach)
    assert np.allclose(found, expected, rtol=0.0, atol=1e-11)
    assert not found[~HOLES].any()


def test_planes_pass_order_one_up_to_every_edge_and_constants_both() -> None:
    i, j = np.indices(HOLES.shape)
    tilted = np.where(HOLES, 3e-6 * i - 5e-6 * j + 1e-3, 0.0)
    assert np.allclose(gaussian(tilted, HOLES, (STEP, STEP), 8 * STEP), tilted, rtol=0.0, atol=1e-12)
    bent = gaussian(tilted, HOLES, (STEP, STEP), 8 * STEP, order=0)
    assert np.abs(bent - tilted).max() > 1e-6
    level = np.where(HOLES, 1e-3, 0.0)
    assert np.allclose(gaussian(level, HOLES, (STEP, STEP), 8 * STEP, order=0), level, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("length", [20, 40, 80])
def test_a_wave_keeps_the_share_of_the_transfer_function(length: int) -> None:
    """exp(-ln 2 (cutoff / length)^2), one half at the cutoff of 40 cells; away from the ends of the map."""
    n = np.arange(400)
    z = np.repeat(A * np.sin(2 * pi * n / length)[:, None], 3, axis=1)
    smooth = gaussian(z, np.ones_like(z, bool), (STEP, STEP), 40 * STEP, axis="x")
    inside = slice(60, 340)
    share = (smooth[inside] * z[inside]).sum() / (z[inside] ** 2).sum()
    assert share == pytest.approx(np.exp(-log(2) * (40 / length) ** 2), rel=0.0, abs=1e-4)


def test_s_and_l_filters_divide_the_waves() -> None:
    """Of a short and a long wave each filter leaves one; both together leave the band between them."""
    n, flat = np.arange(480), np.ones((1, 5))
    long, short = A * np.sin(2 * pi * n / 240)[:, None] * flat, A / 4 * np.sin(2 * pi * n / 8)[:, None] * flat
    map_ = map_of(long + short, STEP, 20 * STEP)
    low = number(areal(map_, f_operation="none", s_filter=80 * STEP), "Sq")
    high = number(areal(map_, f_operation="none", l_filter=80 * STEP), "Sq")
    assert low == pytest.approx(A / sqrt(2) * 0.926, rel=0.01, abs=0.0)  # 2^(-1/9) of the long wave
    assert high == pytest.approx(sqrt((A / 4) ** 2 + (A * 0.074) ** 2) / sqrt(2), rel=0.02, abs=0.0)


def test_filters_of_surfaces_have_the_order_that_is_wanted() -> None:
    z, used = rough(), np.ones((24, 17), np.bool_)
    orders: tuple[FilterOrder, ...] = (0, 1)
    smooth = {order: gaussian(z, used, (STEP, STEP), 8 * STEP, order=order) for order in orders}
    for order, expected in smooth.items():
        how = Treatment("none", s_filter=8 * STEP, filter_order=order)
        filtered = s_filtered(map_of(z), how)
        assert isinstance(filtered, HeightMap)
        assert np.allclose(filtered.z, expected, rtol=0.0, atol=1e-15)
        heights = surface_of(map_of(z), f_operation="none", s_filter=8 * STEP, filter_order=order).z
        assert np.allclose(heights, expected - expected.mean(), rtol=0.0, atol=1e-15)
    assert np.abs(smooth[1] - smooth[0]).max() > 1e-7


def test_heights_are_counted_from_their_mean() -> None:
    """Which an L-filter moves away from zero."""
    heights = surface_of(map_of(np.where(HOLES, rough(), np.nan)), f_operation="plane", l_filter=6 * STEP).heights
    assert heights.mean() == pytest.approx(0.0, abs=1e-18)


def test_filters_that_do_not_fit_are_refused() -> None:
    map_ = map_of(wave(60, 30))
    assert "wider than the cells that count, 300 µm" in reason(areal(map_, l_filter=31 * STEP), "Sa")
    assert "narrower than 4 cells of 10 µm" in reason(areal(map_, s_filter=3 * STEP), "Sa")
    used = np.ones((60, 60), np.bool_)
    assert "narrower than 4 cells of 20 µm" in (cutoff_error(used, (STEP, 2 * STEP), 6 * STEP) or "")
    assert cutoff_error(used, (STEP, 2 * STEP), 8 * STEP) is None
    assert cutoff_error(np.ones((60, 30), np.bool_), (STEP, STEP), 30 * STEP) is None
    assert "leaves nothing between" in reason(areal(map_, s_filter=20 * STEP, l_filter=20 * STEP), "Sa")
