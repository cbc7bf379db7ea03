"""The printed solid: whose ink fills a place, and what share of the geometry is missed."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from inkloop.component import Ink, Job
from inkloop.results.solid import ink_error, layer_ink, mismatch, region_edges, voxels, wanted
from support.half_spaces import Below

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))


def printed(heights: list[float], inks: list[int], boundary: float) -> xr.Dataset:
    """Flat layers up to the given heights [um], each of one ink, where ink A belongs below a boundary [um]."""
    height = np.broadcast_to(np.array([0.0, *heights])[:, None, None] * 1e-6, (len(heights) + 1, 4, 4))
    pattern = np.broadcast_to(np.array([0, *inks], np.int32)[:, None, None], height.shape)
    arrays = {"height": (("layer", "x", "y"), height), "pattern": (("layer", "x", "y"), pattern)}
    part = {"target_height": (("x", "y"), height[-1]), "mask": (("x", "y"), np.ones((4, 4), np.bool_))}
    run = xr.Dataset({**arrays, **part}, attrs={"pitch": 263.256e-6})
    job = Job(4, 4, 263.256e-6, height[-1], np.ones((4, 4), np.bool_), INKS, Below(boundary * 1e-6))
    ink = np.array([layer_ink(layer, INKS) for layer in pattern])
    regions = {name: (("interval", "x", "y"), edges) for name, edges in region_edges(job).items()}
    return run.assign(regions).assign(ink=(("layer", "x", "y"), ink), mismatch=mismatch(height, ink, job))


def test_a_cell_belongs_to_its_own_droplet_else_to_the_ink_that_spreads_most_into_it() -> None:
    pattern = np.full((3, 3), 1, np.int32)
    pattern[1, 1] = 2
    assert layer_ink(pattern, INKS)[1, 1] == 2
    pattern = np.zeros((3, 3), np.int32)
    pattern[0, 1], pattern[0, 0] = 2, 1  # B from a side, A from a corner
    assert layer_ink(pattern, INKS)[1, 1] == 2
    assert layer_ink(pattern, INKS)[2, 2] == 0  # nothing near


def test_voxels_hold_the_ink_of_the_layer_that_reaches_them() -> None:
    assert voxels(printed([7.0, 14.0], [1, 2], 7.0))[2, 2].tolist() == [1] * 7 + [2] * 7


@pytest.mark.parametrize(("boundary", "expected"), [(8.0, 2.0 / 8.0), (10.0, 0.0), (12.0, 2.0 / 12.0)])
def test_mismatch_is_the_share_that_is_too_much_or_lacking(boundary: float, expected: float) -> None:
    found = float(printed([10.0, 20.0], [1, 2], boundary).mismatch)
    assert found == pytest.approx(expected, rel=1e-9, abs=0.0)


def test_interval_that_a_cell_does_not_have_is_unknown_at_both_ends() -> None:
    class OneOrTwo:
        def intervals(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
            edges = np.broadcast_to(np.reshape([1.0, 2.0, 3.0, 4.0], (2, 2, 1, 1)), (2, 2, *x.shape)).copy()
            edges[1, :, 0, 1] = 5.0, -5.0
            edges[1, :, 2, 2] = 4.0, 4.0
            return edges

    job = Job(3, 4, 1e-4, np.zeros((3, 4)), np.ones((3, 4), np.bool_), INKS, OneOrTwo())  # type: ignore[arg-type]
    edges = region_edges(job)
    for name, first, second in (("region_bottom", 1.0, 3.0), ("region_top", 2.0, 4.0)):
        expected = np.stack([np.full((3, 4), first), np.full((3, 4), second)])
        expected[1, 0, 1] = np.nan
        expected[1, 2, 2] = 4.0
        np.testing.assert_array_equal(edges[name], expected)


def test_ink_a_above_the_target_is_too_much() -> None:
    height = np.array([0.0, 13e-6])[:, None, None] * np.ones((2, 4, 4))
    job = Job(4, 4, 263.256e-6, np.full((4, 4), 10e-6), np.ones((4, 4), np.bool_), INKS, Below(1.0))
    assert mismatch(height, np.ones((2, 4, 4), np.int8), job) == pytest.approx(0.3, rel=1e-9, abs=0.0)


@pytest.mark.parametrize(("boundary", "first", "after"), [(16.0, 16, 20), (24.0, 20, 24)])
def test_error_of_ink_a_is_what_is_missing_or_too_much_within_reach(boundary: float, first: int, after: int) -> None:
    run = printed([20.0, 40.0], [1, 2], boundary)
    assert wanted(run)[1, 1].sum() == boundary
    error = ink_error(run, reach_m=3e-6)[1, 1] * 1e6
    assert error[19] == pytest.approx(boundary - 20.0, rel=1e-6, abs=0.0)  # missing is positive
    np.testing.assert_array_equal(np.flatnonzero(error != 0.0), np.arange(first - 3, after + 3))
