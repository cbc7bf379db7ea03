"""Invariants of the layer-to-layer model (Lu, Zheng, Mishra 2015), shown on the FMU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.fmus.fmu_driver import DISCARD, ERROR, OK, Driver, random_patterns
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


@settings(max_examples=25)
@given(st.integers(0, 2**31), st.floats(0.0, 50e-6))
def test_interior_droplet_always_adds_its_full_height(seed, roughness) -> None:
    start = np.random.default_rng(seed).uniform(0.0, roughness, (7, 6))
    pattern = np.zeros((7, 6), dtype=np.int32)
    pattern[1:-1, 1:-1] = np.random.default_rng(seed + 1).integers(0, 3, (5, 4))
    before, after = printed(7, 6, [pattern], height_start=start)
    assert (after - before).sum() == pytest.approx((pattern > 0).sum() * FULL, rel=1e-9, abs=1e-20)


def test_what_leaves_over_the_open_edge_is_counted() -> None:
    pitch = 2e-4
    with Driver("LayerDeposition", nx=4, ny=7).start({"pitch": pitch}) as fmu:
        for pattern in random_patterns(4, 7, 5):
            fmu.print_layer(pattern)
        droplets = fmu.get("droplets_a") + fmu.get("droplets_b")
        left = fmu.get("volume_lost")
        assert left > 0.0
        assert fmu.get("height").sum() + left / pitch**2 == pytest.approx(droplets * FULL, rel=1e-12, abs=0.0)


def test_materials_differ_where_their_inks_do() -> None:
    inks = ((5e-6, 0.5e-6, 0.1e-6), (3e-6, 0.9e-6, 0.3e-6))
    parameters = {f"h{k + 1}_{letter}": ink[k] for letter, ink in zip("ab", inks, strict=True) for k in range(3)}
    patterns = random_patterns(6, 5, 4)
    surface = np.zeros((6, 5))
    for found, pattern in zip(printed(6, 5, patterns, **parameters)[1:], patterns, strict=True):
        surface, _ = lu_numpy.layer(surface, pattern, inks)
        assert found == pytest.approx(surface, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("rotation", [0, 1, 3])
def test_each_of_four_passes_acts_on_the_surface_of_the_last(order, rotation) -> None:
    patterns = random_patterns(7, 6, 5)
    surface = np.zeros((7, 6))
    found = printed(7, 6, patterns, passes=4, pass_order=order, pass_rotation=rotation)[1:]
    for number, pattern in enumerate(patterns, start=1):
        surface, _ = lu_numpy.layer(surface, pattern, passes=4, order=order, rotation=rotation, number=number)
        assert found[number - 1] == pytest.approx(surface, rel=1e-12, abs=0.0)
    assert np.abs(found[-1] - printed(7, 6, patterns)[-1]).max() > 0.1e-6


def drawn(kind: int, layers: int = 3, **more):
    """The factors that a print shows: without h2 and h3 a droplet adds h1 times its factor, to its own cell only."""
    with Driver("LayerDeposition", nx=6, ny=8).start({"h2_a": 0.0, "h3_a": 0.0, "variation_kind": kind, **more}) as fmu:
        surfaces = [fmu.get("height"), *(fmu.print_layer(1) for _ in range(layers))]
    return np.diff(surfaces, axis=0) / H1


def test_each_kind_of_variation_is_common_to_what_it_says() -> None:
    droplet, cell, layer, product = (drawn(kind, variation=0.4) for kind in (1, 2, 3, 4))
    assert len(np.unique(droplet.round(12))) == droplet.size
    assert 0.6 <= droplet.min() < 0.65
    assert 0.95 < droplet.max() <= 1.0
    np.testing.assert_allclose(cell, np.broadcast_to(cell[:1], cell.shape), rtol=1e-9)
    assert len(np.unique(cell[0].round(9))) == cell[0].size
    np.testing.assert_allclose(layer, np.broadcast_to(layer[:, :1, :1], layer.shape), rtol=1e-9)
    assert len(np.unique(layer[:, 0, 0].round(9))) == 3
    np.testing.assert_allclose(product, cell * layer, rtol=1e-9)
    assert abs(np.corrcoef(droplet.ravel(), drawn(1, variation=0.4, seed=2).ravel())[0, 1]) < 0.3


def test_volume_factor_scales_all_heights_of_a_droplet_together() -> None:
    patterns = random_patterns(7, 6, 4)
    scaled = {f"{height}_a": 0.7 * value for height, value in (("h1", H1), ("h2", H2), ("h3", H3))}
    scaled |= {f"{height[:2]}_b": value for height, value in scaled.items()}
    assert printed(7, 6, patterns, volume_factor=0.7)[-1] == pytest.approx(
        printed(7, 6, patterns, **scaled)[-1],
        rel=1e-12,
        abs=0.0,
    )
    np.testing.assert_array_equal(printed(7, 6, patterns, volume_factor=1.0), printed(7, 6, patterns))


def test_droplet_of_several_drops_is_an_ink_of_so_many_heights() -> None:
    patterns = random_patterns(7, 6, 4)
    scaled = {f"h{k + 1}_{letter}": 3 * height for letter in "ab" for k, height in enumerate(lu_numpy.INK)}
    three = printed(7, 6, patterns, drop_level=3)
    assert three[-1] == pytest.approx(printed(7, 6, patterns, **scaled)[-1], rel=1e-12, abs=0.0)
    np.testing.assert_array_equal(printed(7, 6, patterns, drop_level=0), np.zeros((5, 7, 6)))


def test_drops_are_counted_one_by_one() -> None:
    pattern = np.array([[1, 1, 2], [0, 2, 1]], dtype=np.int32)
    with Driver("LayerDeposition", nx=2, ny=3).start({"drop_level": [[2, 0, 255], [7, 1, 1]]}) as fmu:
        fmu.print_layer(pattern)
        assert (fmu.get("droplets_a"), fmu.get("droplets_b")) == (3, 256)


def test_drop_levels_are_taken_when_the_command_is_accepted() -> None:
    with Driver("LayerDeposition", nx=3, ny=3).start({"layer_duration": 2.0, "drop_level": 2}) as fmu:
        assert max(fmu.set("layer_command", 1), fmu.step(0.0), fmu.set("drop_level", 0), fmu.step(1.0)) == OK
        assert (fmu.get("layers_printed"), fmu.get("droplets_a")) == (1, 18)


def test_roller_leaves_no_cell_above_its_height_and_counts_what_it_cuts() -> None:
    pitch, step = 2e-4, 6e-6
    with Driver("LayerDeposition", nx=8, ny=7).start({"pitch": pitch, "roller_step": step, "variation": 0.1}) as fmu:
        for number in range(1, 6):
            surface = fmu.print_layer(1)
            assert surface.max() == number * step
        factor = sum(lu_numpy.factors((8, 7), number, seed=0, variation=0.1).sum() for number in range(1, 6))
        gone = (fmu.get("volume_lost") + fmu.get("volume_removed")) / pitch**2
        assert fmu.get("volume_removed") > 0.0
        assert surface.sum() + gone == pytest.approx(factor * FULL, rel=1e-12, abs=0.0)


def test_roller_counts_layers_from_its_datum_on_also_in_a_resumed_print() -> None:
    """Two layers after layer 4 would reach 15.2 um."""
    resumed = printed(5, 5, [1, 1], roller_step=2e-6, roller_datum=1e-6, layer_command=4)
    assert [surface.max() for surface in resumed[1:]] == pytest.approx([FULL, 13e-6], rel=1e-12, abs=0.0)


FAR = [4.4e-6, 0.6e-6, 0.2e-6, 0.15e-6, 0.1e-6, 0.05e-6, 0.04e-6, 0.03e-6, 0.02e-6, 0.01e-6]


def far_heights(*, materials: str = "ab") -> dict[str, float]:
    return {f"h{k}_{letter}": height for letter in materials for k, height in enumerate(FAR, start=1)}


@pytest.mark.parametrize("reach", [2, 3])
@pytest.mark.parametrize(("nx", "ny"), [(9, 8), (1, 5), (2, 2)])
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


def test_nozzle_jets_every_cell_of_its_lines_alike() -> None:
    factor = drawn(1, nozzle_pitch=3, nozzle_variation=0.4)
    assert factor[:, :, :3] == pytest.approx(factor[:, :, 3:6], rel=1e-9, abs=0.0)
    assert np.ptp(factor, axis=(0, 1)) == pytest.approx(0.0, abs=1e-9)
    assert len(np.unique(factor[0, 0].round(9))) == 3


@pytest.mark.parametrize(("variation", "mean_um"), [(0.2, 53 * 7.6 * 0.9), (0.4, 53 * 7.6 * 0.8)])
def test_open_loop_print_falls_short_by_the_mean_of_the_factors(variation, mean_um) -> None:
    """Mean height of 53 layers is 53 x 7.6 um times the mean factor 1 - p / 2, to 4 standard errors."""
    with Driver("LayerDeposition", nx=20, ny=20).start({"variation": variation}) as fmu:
        for _ in range(53):
            fmu.print_layer(1)
        lost = fmu.get("volume_lost") / 263.256e-6**2
        mean = (fmu.get("height").sum() + lost) / 400 * 1e6
    standard_error = 53 * 7.6 * variation / np.sqrt(12 * 53 * 400)
    assert abs(mean - mean_um) < 4 * standard_error


def test_print_continues_where_another_ended() -> None:
    """Layer numbers start at layer_command, so a resumed print draws the same factors."""
    patterns = random_patterns(5, 4, 4)
    parameters = {"variation": 0.3, "passes": 4, "pass_rotation": 1, "seed": 5}
    whole = printed(5, 4, patterns, **parameters)
    resumed = printed(5, 4, patterns[2:], **parameters, layer_command=2, height_start=whole[2])
    assert np.array_equal(resumed[-1], whole[-1])


def test_sizes_and_values_out_of_range_are_refused() -> None:
    with Driver("LayerDeposition") as fmu:
        assert fmu.set("passes", 2) == DISCARD
        assert fmu.set("variation", 1.5) == DISCARD
        assert fmu.set("pass_order", 3) == DISCARD
        assert fmu.set("nx", 4) == ERROR
        assert fmu.resize(0, 3) == DISCARD
        assert "passes is 2; expected 1 or 4" in fmu.messages[0]
        assert fmu.get("passes") == 1


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
