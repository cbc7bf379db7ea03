"""The first scan of a print on devices: a profiler that sees nothing, a bed that is not empty."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_hardware.devices.profiler import FirstScanError, check_first_scan
from support.closed_loop import block

JOB = block(20, 30)
LAYER = 7.6e-6  # h1 + 4 h2 + 4 h3 of the default ink


def scan(**heap: Any) -> tuple[Any, Any]:
    """A bed that is tilted by 100 um both ways and read with 1 um of noise; heap: [m] on the cells of `where`."""
    i, j = np.indices((20, 30))
    height = 100e-6 * (i / 19.0 - j / 29.0) + np.random.default_rng(1).normal(0.0, 1e-6, (20, 30))
    if heap:
        height[heap["where"]] += heap["height"]
    return height, np.ones((20, 30), np.bool_)


def check(height: Any, valid: Any, job: Any = JOB, valid_share: float = 0.5, on_part: bool = False) -> None:
    rig: Any = SimpleNamespace(valid_share=valid_share, on_part=on_part)
    check_first_scan(height, valid, job, rig)


def test_tilted_empty_bed_with_spikes_is_well() -> None:
    height, valid = scan()
    height[3, 3] = height[17, 2] = 500e-6
    height[5, 6] = -500e-6
    check(height, valid)


@pytest.mark.parametrize("share", [0.0, 0.49])
def test_profiler_that_sees_too_little_is_refused(share: float) -> None:
    height, valid = scan()
    valid.flat[round(share * valid.size) :] = False
    with pytest.raises(FirstScanError, match=rf"first scan: {share:.0%} of its cells are valid; needs 50% .*covered"):
        check(height, valid)
    check(height, valid, valid_share=share)


@pytest.mark.parametrize(
    "where",
    [np.s_[2:6, 3:9], np.s_[:14, 10:], np.s_[:, :14], np.s_[:, :21]],
    ids=["4 %", "half, at a corner", "half, one side", "seven tenths"],
)
def test_bed_with_a_part_is_refused_with_its_height_unless_it_may_carry_one(where: Any) -> None:
    height, valid = scan(where=where, height=60e-6)
    cells = np.zeros(height.shape)
    cells[where] = 1.0
    with pytest.raises(FirstScanError, match=rf"bed: {int(cells.sum())} of 600 cells .* highest 6\d .*--on-part"):
        check(height, valid)
    check(height, valid, on_part=True)
    check(height, valid, replace(JOB, height_start=np.zeros((20, 30))))


def test_levelling_of_less_than_three_layers_is_no_part() -> None:
    check(*scan(where=np.s_[2:10, 3:9], height=2.0 * LAYER))


def test_more_than_three_layers_of_the_thickest_ink_are_a_part() -> None:
    height, valid = scan(where=np.s_[2:10, 3:9], height=4.0 * LAYER)
    with pytest.raises(FirstScanError, match=r"48 of 600 cells stand more than 23 µm above it"):
        check(height, valid)
    check(height, valid, replace(JOB, inks=(Ink(), Ink(h1=8e-6))))


def test_fiftieth_of_the_cells_may_stand_out() -> None:
    check(*scan(where=np.s_[2, 3:15], height=60e-6))
    with pytest.raises(FirstScanError, match="13 of 600 cells"):
        check(*scan(where=np.s_[2, 3:16], height=60e-6))


def test_tilt_is_that_of_the_cells_that_were_seen() -> None:
    """Others are 0, wherever the bed is: of two fifths of the grid, of one line, of a grid of few lines."""
    height, valid = scan()
    valid[:, 12:] = False
    check(np.where(valid, height + 500e-6, 0.0), valid, valid_share=0.3)
    line, seen = scan(where=np.s_[3, 10:25], height=60e-6)
    seen[:3] = seen[4:] = False
    with pytest.raises(FirstScanError, match=r"bed: 15 of 30 cells"):
        check(line, seen, valid_share=0.0)
    check(*(each[:5, :6] for each in scan()))
    heap = scan(where=np.s_[1:3, 1:3], height=60e-6)
    with pytest.raises(FirstScanError, match=r"bed: 4 of 30 cells"):
        check(*(each[:5, :6] for each in heap))
