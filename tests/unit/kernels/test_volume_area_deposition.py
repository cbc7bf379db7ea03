"""Invariants of the propagation of volume and area (Wu, Chiu 2024), shown on the FMU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.fmus.fmu_driver import OK, Driver, random_patterns
from support.numpy import lu_numpy, wu_chiu_numpy

C = 7.0751e-6
COLOURS = {1: [(0, 0), (0, 1), (1, 0), (1, 1)], 2: [(0, 0), (1, 1), (0, 1), (1, 0)]}


def prints(nx: int, ny: int, patterns, **parameters):
    """Height and area after the last layer."""
    with Driver("VolumeAreaDeposition", nx=nx, ny=ny).start(parameters) as fmu:
        for pattern in patterns:
            fmu.print_layer(pattern)
        return fmu.get("height"), fmu.get("area")


def sparse(nx: int, ny: int, layers: int, seed: int):
    generator = np.random.default_rng(seed)
    return [(generator.random((nx, ny)) < 0.5).astype(np.int32) for _ in range(layers)]


def one_drop(nx: int, ny: int, i: int, j: int):
    pattern = np.zeros((nx, ny), dtype=np.int32)
    pattern[i, j] = 1
    return pattern


@pytest.mark.parametrize("options", [{}, {"guard": True}, {"limit_gains": True}, {"guard": True, "limit_gains": True}])
@pytest.mark.parametrize(("nx", "ny"), [(7, 4), (4, 7), (1, 6), (5, 1), (1, 1), (2, 2)])
@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("passes", [1, 4])
def test_layers_are_those_of_the_reference_model(options, nx, ny, order, passes) -> None:
    substrate = np.random.default_rng(nx * ny).uniform(0.0, 3.0, (nx, ny))
    varied: dict[str, Any] = {"variation": 0.3, "seed": 7}
    v, a = np.zeros((nx, ny)), np.zeros((nx, ny))
    shares = wu_chiu_numpy.cap_shares(54.0)
    reading = {"guard": options.get("guard", False), "limit": options.get("limit_gains", False)}
    own = {"drop_order": order, "passes": passes, "pass_order": 2, "height_start": substrate * 1e-6}
    with Driver("VolumeAreaDeposition", nx=nx, ny=ny).start({**options, **varied, **own}) as fmu:
        for number, pattern in enumerate(random_patterns(nx, ny, 3), start=1):
            factor = lu_numpy.factors((nx, ny), number, **varied)
            colours = COLOURS[2] if passes == 4 else None
            for i, j in wu_chiu_numpy.cells_in_order((nx, ny), order, colours):
                if pattern[i, j] > 0:
                    wu_chiu_numpy.drop(v, a, substrate, i, j, factor[i, j], shares, **reading)
            scale = 1e-6 * np.abs(wu_chiu_numpy.heights(v, a)).max()
            assert fmu.print_layer(pattern) == pytest.approx(1e-6 * (substrate + 7.0751 * v), abs=1e-11 * scale)
            assert fmu.get("area") == pytest.approx(a, abs=1e-9)


@pytest.mark.parametrize("guard", [False, True])
@pytest.mark.parametrize("ma_plus", [3e4, -3e4])
def test_area_of_a_cell_above_its_surroundings_changes_by_its_own_factor(ma_plus: float, guard: bool) -> None:
    """And stays within 0 to 1."""
    substrate, v, a = np.random.default_rng(3).uniform(0.0, 3.0, (6, 5)), np.zeros((6, 5)), np.zeros((6, 5))
    own = {"ma_plus": ma_plus, "guard": guard, "height_start": substrate * 1e-6}
    with Driver("VolumeAreaDeposition", nx=6, ny=5).start(own) as fmu:
        for pattern in sparse(6, 5, 2, 1):
            for i, j in wu_chiu_numpy.cells_in_order((6, 5), 1, None):
                if pattern[i, j] > 0:
                    shares = wu_chiu_numpy.cap_shares(54.0)
                    wu_chiu_numpy.drop(v, a, substrate, i, j, 1.0, shares, guard=guard, ma_plus=1e-6 * ma_plus)
            fmu.print_layer(pattern)
            assert fmu.get("area") == pytest.approx(a, abs=1e-9)


def test_smallest_unevenness_is_no_flat_ground() -> None:
    """On flat ground a drop is a cap that covers its neighbours; beside a rise of 0.1 nm it is propagated."""
    start = np.zeros((5, 5))
    flat, _ = prints(5, 5, [one_drop(5, 5, 2, 2)], height_start=start)
    start[2, 3] = 1e-10
    uneven, area = prints(5, 5, [one_drop(5, 5, 2, 2)], height_start=start)
    assert flat[2, 1] > 0.01e-6
    assert uneven[2, 2] == pytest.approx(C, rel=1e-3, abs=0.0)
    assert area.sum() == pytest.approx(1.0, abs=1e-3)


def test_volume_of_6250_drops_is_conserved_to_1e_12() -> None:
    height, area = prints(25, 25, [1] * 10, guard=True)
    assert height.sum() == pytest.approx(6250 * C, rel=1e-12, abs=0.0)
    assert np.all(area == 1.0)


@pytest.mark.parametrize(("i", "j"), [(2, 2), (0, 2), (0, 0)])
def test_drop_on_flat_ground_is_a_cap_and_what_lies_outside_stays_with_the_hit_cell(i, j) -> None:
    volume, covered = wu_chiu_numpy.cap_shares(54.0)
    height, area = prints(5, 5, [one_drop(5, 5, i, j)], height_start=20e-6)
    ink = (height - 20e-6) / C
    expected, share = np.zeros((7, 7)), np.zeros((7, 7))
    expected[i : i + 3, j : j + 3], share[i : i + 3, j : j + 3] = volume, covered
    expected, share = expected[1:-1, 1:-1], share[1:-1, 1:-1]
    expected[i, j] += 1.0 - expected.sum()
    assert ink == pytest.approx(expected, abs=1e-10)
    assert area == pytest.approx(share, abs=1e-10)


def test_droplets_of_no_drops_cover_nothing() -> None:
    with Driver("VolumeAreaDeposition", nx=5, ny=4).start({}) as fmu:
        assert fmu.set("drop_level", one_drop(5, 4, 1, 2)) == OK
        surface = fmu.print_layer(1)
        alone, area = prints(5, 4, [one_drop(5, 4, 1, 2)])
        np.testing.assert_array_equal(surface, alone)
        np.testing.assert_array_equal(fmu.get("area"), area)
        assert fmu.get("droplets_a") == 1


@pytest.mark.system
def test_guard_keeps_200_random_prints_in_bounds_where_the_literal_equations_run_away() -> None:
    """Three layers can be three drops high where nothing flows; the literal area of a higher cell never grows."""
    highest: dict[str, list[float]] = {"literal": [], "guard": []}
    for seed in range(200):
        patterns = sparse(8, 8, 3, seed)
        for name, guard in (("literal", False), ("guard", True)):
            height, area = prints(8, 8, patterns, guard=guard)
            covered = np.divide(height, area, out=np.zeros_like(height), where=area > 0)
            highest[name].append(np.abs(covered).max() / C)
            if guard:
                assert height.min() >= 0.0
    assert max(highest["guard"]) <= 3.5
    assert 0.15 <= np.mean(np.array(highest["literal"]) > 10.0) <= 0.35


def test_limited_gains_never_take_ink_from_the_hit_cell() -> None:
    ground = np.zeros((3, 3))
    ground[1, 1] = 400e-6
    pattern = one_drop(3, 3, 1, 1)
    literal, limited = (prints(3, 3, [pattern], height_start=ground, limit_gains=limit)[0] for limit in (False, True))
    assert literal[1, 1] < ground[1, 1]
    assert limited[1, 1] == pytest.approx(ground[1, 1], rel=1e-12, abs=0.0)
    assert (limited - ground).sum() == pytest.approx(C, rel=1e-12, abs=0.0)
