"""Overhangs: found by geometry, held by support, or left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from inkloop.geometry import Columns, Cuboid, PipeJunction, cell_centers, overhangs, resting, support_below

UM = 1e-6
PITCH = 100 * UM
NX, NY = 12, 9


def columns(intervals: Callable[[Any, Any], Any]) -> Columns:
    """Columns of closed intervals over the grid."""

    class Part:
        def contains(self, x: Any, y: Any, z: Any) -> Any:
            raise NotImplementedError

        def intervals(self, x: Any, y: Any) -> Any:
            return intervals(x, y)

    return Columns.of_shape(Part(), NX, NY, PITCH)


def bridge() -> Columns:
    """Two piers of 100 um, two cells wide, and a deck from 60 to 100 um between them over five."""
    deck = Cuboid(6 * PITCH, 4 * PITCH, 8 * PITCH, 4 * PITCH, 100 * UM)

    def intervals(x: Any, y: Any) -> Any:
        ((bottom, top),) = deck.intervals(x, y)
        is_free = np.abs(x - 6 * PITCH) < 2.5 * PITCH
        return ((np.where(is_free & (bottom <= top), 60 * UM, bottom), top),)

    return columns(intervals)


def mushroom() -> Columns:
    """A stem with a radius of one cell and a cap of three, from 40 to 70 um."""

    def intervals(x: Any, y: Any) -> Any:
        far = np.hypot(x - 6 * PITCH, y - 4 * PITCH)
        cap = np.where(far <= 3.01 * PITCH, 40 * UM, np.inf), np.full_like(x, 70 * UM)
        stem = np.where(far <= 1.01 * PITCH, 0.0, np.inf), np.full_like(x, 50 * UM)
        return cap, stem

    return columns(intervals)


def gyroid() -> Columns:
    """Intervals as of a lattice: four on each cell, every second cell begins on the substrate."""

    def intervals(x: Any, y: Any) -> Any:
        start = np.where(np.round(x / PITCH) % 2 == 0, 0.0, 12 * UM)
        return [(start + k * 20 * UM, start + k * 20 * UM + 9 * UM) for k in range(4)]

    return columns(intervals)


@pytest.mark.parametrize("height_um", [50.0, 0.01])
def test_part_that_stands_on_the_substrate_has_no_overhang(height_um: float) -> None:
    part = Columns.of_shape(Cuboid(6e-4, 4e-4, 3e-4, 3e-4, height_um * UM), NX, NY, PITCH)
    assert overhangs(part) is None
    assert support_below(part).volume == 0.0
    np.testing.assert_array_equal(resting(part).mask, part.mask)
    assert part.mask.sum() == 9


def test_deck_of_a_bridge_hangs_between_its_piers() -> None:
    found = overhangs(bridge())
    assert found is not None
    assert (found.cells, found.first) == (5 * 5, (4, 2))
    assert found.share == pytest.approx(25 / 45, rel=1e-12, abs=0.0)
    assert (found.bottom, found.tallest) == pytest.approx((60 * UM, 60 * UM), rel=1e-9, abs=0.0)


def test_cap_of_a_mushroom_hangs_around_its_stem_alone() -> None:
    part = mushroom()
    found, cap, stem = overhangs(part), int(part.mask.sum()), int(resting(part).mask.sum())
    assert found is not None
    assert (found.cells, stem) == (cap - 5, 5)
    assert found.tallest == pytest.approx(40 * UM, rel=1e-9, abs=0.0)
    x, y = cell_centers(NX, NY, PITCH)
    assert resting(part).top(x, y)[6, 4] == pytest.approx(70 * UM, rel=1e-9, abs=0.0)  # the stem goes through the cap


def test_every_interval_over_another_hangs_in_a_lattice() -> None:
    found = overhangs(gyroid())
    assert found is not None
    assert (found.cells, found.share, found.first) == (NX * NY, 1.0, (0, 0))
    assert found.bottom == pytest.approx(20 * UM, rel=1e-9, abs=0.0)
    assert found.tallest == pytest.approx(12 * UM, rel=1e-9, abs=0.0)
    assert int(resting(gyroid()).mask.sum()) == NX // 2 * NY


@pytest.mark.parametrize("make", [bridge, mushroom, gyroid])
def test_part_and_support_stand_together_without_gap_or_overlap(make: Callable[[], Columns]) -> None:
    part, support = make(), support_below(make())
    both = part | support
    assert (part & support).volume == 0.0
    assert overhangs(both) is None
    assert (both.counts <= 1).all()
    np.testing.assert_array_equal(both.mask, part.mask)
    x, y = cell_centers(NX, NY, PITCH)
    np.testing.assert_array_equal(both.top(x, y), part.top(x, y))
    empty = sum(
        part.tops[last - 1] - (part.tops - part.bottoms)[first:last].sum()
        for first, last in zip(part.offsets[:-1], part.offsets[1:], strict=True)
        if last > first
    )
    assert support.volume == pytest.approx(empty * PITCH**2, rel=1e-6, abs=0.0)


def test_walls_of_a_pipe_that_touch_in_the_middle_are_one() -> None:
    """Where the bores end, their walls part by the last bit of a number: nothing hangs there."""
    pipes = PipeJunction(6e-4, 4e-4, 3e-4, 30 * UM, 2e-4, 20 * UM, 60 * UM)
    part = Columns.of_shape(pipes, NX, NY, PITCH)
    found = overhangs(part)
    assert found is not None
    assert found.tallest == pytest.approx(40 * UM, rel=1e-6, abs=0.0)  # the height of a bore


def test_what_lies_below_the_substrate_holds_and_hangs_nowhere() -> None:
    sunk = columns(lambda x, y: [(np.full_like(x, -20 * UM), np.full_like(x, -10 * UM)), (x * 0 - UM, x * 0 + 5 * UM)])
    assert overhangs(sunk) is None
    assert resting(sunk).mask.all()
    under = columns(lambda x, y: [(np.full_like(x, -20 * UM), np.full_like(x, -10 * UM)), (x * 0 + UM, x * 0 + 5 * UM)])
    assert not resting(under).mask.any()
    assert overhangs(under) is not None


@pytest.mark.parametrize(("gap", "hangs"), [(0.9e-7, False), (1.1e-7, True)])
def test_gap_within_the_rounding_of_a_mesh_is_closed(gap: float, hangs: bool) -> None:
    part = columns(lambda x, y: [(x * 0, x * 0 + 5 * UM), (x * 0 + 5 * UM + gap, x * 0 + 9 * UM)])
    assert (overhangs(part) is not None) == hangs
    x, y = cell_centers(NX, NY, PITCH)
    np.testing.assert_allclose(resting(part).top(x, y), 5 * UM if hangs else 9 * UM, rtol=1e-9)


def test_rounding_of_a_mesh_is_no_overhang() -> None:
    """Coordinates in single precision, 100 mm from their origin, are wrong by some nanometres."""
    rng = np.random.default_rng(0)
    uneven = columns(lambda x, y: [(rng.uniform(-4e-9, 4e-9, x.shape), x * 0 + 5 * UM)])
    assert overhangs(uneven) is None
    assert resting(uneven).mask.all()
