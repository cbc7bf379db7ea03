"""Invariants of the layer-to-layer model (Lu, Zheng, Mishra 2015), shown on the FMU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.fmus.fmu_driver import ERROR, OK, Driver, random_patterns
from support.numpy import lu_numpy

H1, H2, H3 = lu_numpy.INK
FULL = H1 + 4 * H2 + 4 * H3


def printed(nx: int, ny: int, patterns, **parameters):
    """Surfaces after each layer, the start surface first."""
    with Driver("LayerDeposition", nx=nx, ny=ny).start(parameters) as fmu:
        return [fmu.get("height"), *(fmu.print_layer(pattern) for pattern in patterns)]


def test_line_follows_the_formulas_of_section_iii_c() -> None:
    line = printed(1, 9, [1, 1], h3_a=0.0)
    r = H1 * H2 / (H1 + H2)
    first = np.full(9, H1 + 2 * H2)
    first[[0, -1]] = H1 + H2
    second = np.full(9, 2 * H1 + 4 * H2)
    second[[0, -1]] = 2 * H1 + 3 * H2 - r
    second[[1, -2]] = 2 * H1 + 3 * H2 + r
    assert np.abs(line[1][0] - first).max() <= 1e-12 * H1
    assert np.abs(line[2][0] - second).max() <= 1e-12 * H1


def test_four_layers_of_the_9_by_9_cuboid() -> None:
    """Recorded: 27.343 29.592 30.273 30.391 30.4 um along the middle row, 24.536 um at the corners."""
    surface = printed(9, 9, [1] * 4)[-1] * 1e6
    row = [27.343, 29.592, 30.273, 30.391, 30.4]
    assert surface[4] == pytest.approx([*row, *row[3::-1]], abs=6e-4)
    assert surface[[0, 0, -1, -1], [0, -1, 0, -1]] == pytest.approx([24.536] * 4, abs=6e-4)


def drawn(kind: int, layers: int = 3, **more):
    """The factors that a print shows: without h2 and h3 a droplet adds h1 times its factor, to its own cell only."""
    with Driver("LayerDeposition", nx=6, ny=8).start({"h2_a": 0.0, "h3_a": 0.0, "variation_kind": kind, **more}) as fmu:
        surfaces = [fmu.get("height"), *(fmu.print_layer(1) for _ in range(layers))]
    return np.diff(surfaces, axis=0) / H1


def test_each_kind_of_variation_draws_what_it_says() -> None:
    droplet, cell, layer, both = (drawn(kind, variation=0.4) for kind in (1, 2, 3, 4))
    assert len(np.unique(droplet.round(12))) == droplet.size
    assert 0.6 <= droplet.min() < 0.65
    assert 0.95 < droplet.max() <= 1.0
    assert cell[0] == pytest.approx(cell[2], rel=1e-9, abs=0.0)
    assert len(np.unique(cell[0].round(9))) == cell[0].size
    assert np.ptp(layer, axis=(1, 2)) == pytest.approx(0.0, abs=1e-9)
    assert len(np.unique(layer[:, 0, 0].round(9))) == 3
    assert both == pytest.approx(cell * layer, rel=1e-9, abs=0.0)
    nozzle = drawn(1, nozzle_pitch=3, nozzle_variation=0.4)
    assert nozzle[:, :, :3] == pytest.approx(nozzle[:, :, 3:6], rel=1e-9, abs=0.0)
    assert np.ptp(nozzle, axis=(0, 1)) == pytest.approx(0.0, abs=1e-9)
    assert len(np.unique(nozzle[0, 0].round(9))) == 3
    other = drawn(1, variation=0.4, seed=2)
    assert abs(np.corrcoef(droplet.ravel(), other.ravel())[0, 1]) < 0.3
    assert drawn(1, variation=0.4, volume_factor=0.5) == pytest.approx(0.5 * droplet, rel=1e-9, abs=0.0)


def test_roller_counts_layers_from_its_datum_on_also_in_a_resumed_print() -> None:
    """Two layers after layer 4 would reach 15.2 um."""
    resumed = printed(5, 5, [1, 1], roller_step=2e-6, roller_datum=1e-6, layer_command=4)
    assert [surface.max() for surface in resumed[1:]] == pytest.approx([FULL, 13e-6], rel=1e-12, abs=0.0)


FAR = [4.4e-6, 0.6e-6, 0.2e-6, 0.15e-6, 0.1e-6, 0.05e-6, 0.04e-6, 0.03e-6, 0.02e-6, 0.01e-6]


def far_heights(*, materials: str = "ab") -> dict[str, float]:
    return {f"h{k}_{letter}": height for letter in materials for k, height in enumerate(FAR, start=1)}


@pytest.mark.parametrize("reach", [2, 3])
@pytest.mark.parametrize(("nx", "ny"), [(8, 5), (5, 8), (1, 5), (2, 2)])
@pytest.mark.parametrize("passes", [1, 4])
def test_every_neighbour_within_reach_takes_its_share_by_the_same_rule(reach, nx, ny, passes) -> None:
    start = np.random.default_rng(1).uniform(0.0, 10e-6, (nx, ny))
    varied: dict[str, Any] = {"variation": 0.3, "seed": 77}
    surface, lost = start, 0.0
    parameters = {**far_heights(), **varied, "reach": reach, "passes": passes, "height_start": start}
    with Driver("LayerDeposition", nx=nx, ny=ny).start(parameters) as fmu:
        for number, pattern in enumerate(random_patterns(nx, ny, 4), start=1):
            factor = lu_numpy.factors((nx, ny), number, **varied)
            for colour in lu_numpy.ORDERS[1] if passes == 4 else [None]:
                surface, fell = lu_numpy.far_pass(surface, pattern, FAR, reach, factor, colour)
                lost += fell
            assert fmu.print_layer(pattern) == pytest.approx(surface, rel=1e-12, abs=0.0)
        assert fmu.get("volume_lost") == pytest.approx(lost * 263.256e-6**2, rel=1e-12, abs=0.0)


def test_shares_beyond_the_reach_change_nothing() -> None:
    patterns = random_patterns(7, 6, 4)
    near = {f"h{k}_{letter}": 9e-6 for letter in "ab" for k in range(4, 11)}
    np.testing.assert_array_equal(printed(7, 6, patterns, **near), printed(7, 6, patterns))
    second = {name: height for name, height in far_heights().items() if int(name[1:-2]) < 7}
    np.testing.assert_array_equal(
        printed(7, 6, patterns, reach=2, **far_heights()), printed(7, 6, patterns, reach=2, **second)
    )


def test_print_continues_where_another_ended() -> None:
    """Layer numbers start at layer_command, so a resumed print draws the same factors."""
    patterns = random_patterns(5, 4, 4)
    parameters = {"variation": 0.3, "passes": 4, "pass_rotation": 1, "seed": 5}
    whole = printed(5, 4, patterns, **parameters)
    resumed = printed(5, 4, patterns[2:], **parameters, layer_command=2, height_start=whole[2])
    assert np.array_equal(resumed[-1], whole[-1])


def test_grid_that_no_memory_holds_is_refused_and_another_can_follow() -> None:
    with Driver("LayerDeposition") as fmu:
        assert fmu.call("enterConfigurationMode") == OK
        assert fmu.call("setUInt64", fmu.references["nx"] + fmu.references["ny"], [2**40, 2**40]) == OK
        assert fmu.call("exitConfigurationMode") == ERROR
        assert "expected 1 to 67108864 cells together" in fmu.messages[-1]
        assert fmu.call("setUInt64", fmu.references["nx"] + fmu.references["ny"], [3, 2]) == OK
        assert fmu.call("exitConfigurationMode") == OK
        fmu.nx, fmu.ny = 3, 2
        assert fmu.start().print_layer().shape == (3, 2)
