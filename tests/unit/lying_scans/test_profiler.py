"""The profiler of the rig: each fault alone, in the right sense."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.lying_scans.parts import PARTS
from support.lying_scans.places import across
from support.lying_scans.profiler import TURNS, Profiler, displaced, read, shown

OBLONG = (9, 14)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def rough(shape: tuple[int, int] = OBLONG) -> Any:
    return 20.0 * rng().random(shape)


def moved(surface: Any, **faults: Any) -> Any:
    return displaced(Profiler(**faults), surface, 0.0, rng())


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("cells", [1, -2])
def test_shift_reads_further_along_its_axis(axis: int, cells: int) -> None:
    """The reading of cell i is the surface at i + shift; beyond the grid its border goes on."""
    surface = rough()
    places = np.clip(np.arange(OBLONG[axis]) + cells, 0, OBLONG[axis] - 1)
    found = moved(surface, shift=(float(cells), 0.0) if axis == 0 else (0.0, float(cells)))
    assert found == pytest.approx(np.take(surface, places, axis), abs=1e-9)


def test_shift_of_half_a_cell_reads_the_mean() -> None:
    surface = rough()
    assert moved(surface, shift=(0.5, 0.0))[:-1] == pytest.approx((surface[1:] + surface[:-1]) / 2, abs=1e-9)


def test_drift_is_whole_at_the_nominal_end() -> None:
    surface = rough()
    found = displaced(Profiler(shift=(1.0, 0.0), drift=(-2.0, 0.0)), surface, 1.0, rng())
    assert found == pytest.approx(moved(surface, shift=(-1.0, 0.0)), abs=1e-9)


def test_rotation_by_quarters_turns_the_grid() -> None:
    """Cell (i, j) reads the surface at the place turned from x to y, so the picture turns the other way."""
    surface = rough((9, 9))
    assert moved(surface, rotation=90.0) == pytest.approx(np.rot90(surface, -1), abs=1e-9)
    assert moved(surface, rotation=-90.0) == pytest.approx(np.rot90(surface, 1), abs=1e-9)
    assert moved(rough(), rotation=180.0) == pytest.approx(np.rot90(rough(), 2), abs=1e-9)


def test_magnification_reads_further_from_the_middle() -> None:
    i, j = np.indices((11, 7), np.float64)
    assert moved(i, magnification=-0.2) == pytest.approx(5.0 + 0.8 * (i - 5.0), abs=1e-9)
    assert moved(j, magnification=-0.2) == pytest.approx(3.0 + 0.8 * (j - 3.0), abs=1e-9)
    assert moved(i, magnification=0.2)[4:7] == pytest.approx(5.0 + 1.2 * (i - 5.0)[4:7], abs=1e-9)


def test_shear_moves_along_x_with_the_distance_along_y() -> None:
    i, j = np.indices((11, 7), np.float64)
    assert moved(i, shear=0.1)[3:8] == pytest.approx((i + 0.1 * (j - 3.0))[3:8], abs=1e-9)
    assert moved(j, shear=0.1) == pytest.approx(j, abs=1e-9)


def test_spot_keeps_the_mean_and_levels() -> None:
    surface = np.zeros((21, 21))
    surface[10, 10] = 1.0
    wide = moved(surface, spot=1.0)
    assert wide.sum() == pytest.approx(1.0, abs=1e-9)
    assert wide[10, 11] / wide[10, 10] == pytest.approx(np.exp(-0.5), abs=1e-9)


@pytest.mark.parametrize("axis", [0, 1])
def test_jitter_is_one_offset_per_row(axis: int) -> None:
    z, _ = read(Profiler(jitter=1.0, jitter_axis=axis), np.zeros(OBLONG), 1, 0.0, rng())
    assert np.ptp(z, axis=1 - axis).max() == 0.0
    assert np.ptp(z) > 0.5


def test_datum_is_quadratic_and_new_for_every_scan() -> None:
    source, u_w = rng(), across(OBLONG)
    terms = np.stack([np.ones(OBLONG), *u_w, *(a * b for a, b in ((u_w[0], u_w[0]), u_w, (u_w[1], u_w[1])))], -1)
    one, other = (read(Profiler(offset=3.0, tilt=3.0, bow=1.0), np.zeros(OBLONG), 0, 0.0, source)[0] for _ in range(2))
    left = one.ravel() - terms.reshape(-1, 6) @ np.linalg.lstsq(terms.reshape(-1, 6), one.ravel())[0]
    assert np.abs(left).max() < 1e-9
    assert np.abs(one - other).max() > 0.1


def test_readings_are_multiples_of_the_step() -> None:
    z, _ = read(Profiler(noise=2.0, step=0.5), rough(), 0, 0.0, rng())
    assert (z % 0.5 == 0.0).all()


def test_spikes_prefer_walls() -> None:
    surface = np.zeros((20, 20))
    surface[:, 10:] = 50.0
    z, _ = read(Profiler(spikes=0.05), surface, 0, 0.0, rng())
    i, j = np.nonzero(z != surface)
    assert len(i) == 20
    assert set(j) == {9, 10}
    assert set(np.abs(z - surface)[i, j]) == {20.0}


def test_readings_are_missing_as_told() -> None:
    surface = np.zeros((20, 20))
    surface[:, 10:] = 50.0
    _, valid = read(Profiler(walls_missing=12.0), surface, 0, 0.0, rng())
    assert (~valid).nonzero()[1].min() == 9
    assert (~valid).sum() == 40
    seen = [read(Profiler(missing_every=3), surface, layer, 0.0, rng())[1].all() for layer in range(6)]
    assert seen == [True, True, False, True, True, False]


def test_scans_lie_as_told() -> None:
    scans = [(np.full((3, 3), float(layer)), np.ones((3, 3), np.bool_)) for layer in range(5)]

    def numbers(profiler: Profiler) -> list[float]:
        return [shown(profiler, scans[: layer + 1])[0][0, 0] for layer in range(5)]

    assert numbers(Profiler()) == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert numbers(Profiler(frozen_from=3)) == [0.0, 1.0, 2.0, 2.0, 2.0]
    assert numbers(Profiler(late=1)) == [0.0, 0.0, 1.0, 2.0, 3.0]
    assert numbers(Profiler(late=2)) == [0.0, 0.0, 0.0, 1.0, 2.0]
    assert numbers(Profiler(zero=True)) == 5 * [0.0]


def test_orientations_are_the_seven_others_of_a_square() -> None:
    grid = np.arange(9.0).reshape(3, 3)
    seen = {grid.tobytes(), *(np.ascontiguousarray(turn(grid)).tobytes() for turn in TURNS.values())}
    assert len(seen) == 8
    letter = PARTS["letter F"](25, 25)
    assert all((turn(letter) != letter).any() for turn in TURNS.values())
