"""Walls, gaps, sheets and slots that are narrower than droplets make them are found where they are, and no others."""

from __future__ import annotations

import numpy as np

from inkloop.geometry import Columns
from inkloop.report.part_flaws import Narrow, narrow_across, narrow_upright

NX, NY, PITCH = 12, 10, 1e-4


def part(*boxes: tuple[slice, slice, float, float]) -> Columns:
    """Cells of slices along x and y, from a bottom to a top [um]."""
    whole = Columns(NX, NY, PITCH, np.zeros(NX * NY + 1, np.int64), np.zeros(0), np.zeros(0))
    cells = np.arange(NX * NY).reshape(NX, NY)
    for x, y, bottom, top in boxes:
        cell = cells[x, y].ravel()
        ends = (np.full(cell.size, z * 1e-6) for z in (bottom, top))
        whole |= Columns.of_intervals(NX, NY, PITCH, cell, *ends)
    return whole


def marked(found: Narrow | None) -> set[tuple[int, int]]:
    return set() if found is None else {(int(i), int(j)) for i, j in np.argwhere(found.cells)}


def test_single_row_and_single_gap_are_found() -> None:
    wide, fin = (slice(1, 5), slice(1, 6), 0.0, 30.0), (slice(6, 7), slice(1, 6), 0.0, 60.0)
    walls, gaps = narrow_across(part(wide, fin), 2, [15e-6, 45e-6])
    assert marked(walls) == {(6, j) for j in range(1, 6)}
    assert marked(gaps) == {(5, j) for j in range(1, 6)}
    assert walls is not None
    assert walls.first == (6 * PITCH, 1 * PITCH, 15e-6)


def test_gap_to_the_edge_of_the_grid_is_none_and_a_limit_of_cells_counts() -> None:
    block = (slice(1, 11), slice(1, 4), 0.0, 30.0)
    assert [marked(each) for each in narrow_across(part(block), 2, [15e-6])] == [set(), set()]
    assert narrow_across(part(block), 3, [15e-6]) == (None, None), "three cells are not fewer than three"
    walls, gaps = narrow_across(part(block), 4, [15e-6])
    assert marked(walls) == {(i, j) for i in range(1, 11) for j in range(1, 4)}
    assert gaps is None


def test_what_is_lower_than_a_layer_is_found() -> None:
    low, over, far = (
        (slice(1, 4), slice(1, 4), 0.0, 30.0),
        (slice(2, 3), slice(2, 3), 34.0, 50.0),
        (slice(5, 6), slice(5, 6), 0.0, 5.0),
    )
    sheets, slots = narrow_upright(part(low, over, far), 7.6e-6)
    assert marked(sheets) == {(5, 5)}
    assert marked(slots) == {(2, 2)}
    assert slots is not None
    assert np.isclose(slots.first[2], 30e-6, rtol=1e-9, atol=0.0)
    assert narrow_upright(part(low), 7.6e-6) == (None, None)
