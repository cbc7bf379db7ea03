"""Invariants of YoungLaplaceDeposition, shown on the FMU."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from inkloop_lab.models import YoungLaplaceDeposition
from support.fmus.fmu_driver import DISCARD, ERROR, OK, Driver, random_patterns
from support.fmus.young_laplace_library import PITCH, VOLUME, Print

pytestmark = pytest.mark.compiled

MODEL = "YoungLaplaceDeposition"
COARSE = {"cells_per_pitch": 4}


def middle(nx: int, ny: int):
    """Droplets wherever two cells or more from the border."""
    pattern = np.zeros((nx, ny), dtype=np.int32)
    pattern[2:-2, 2:-2] = 1
    return pattern


@pytest.mark.parametrize("form", [1, 2])
@pytest.mark.parametrize("passes", [1, 4])
def test_cell_means_and_what_left_the_grid_are_all_that_was_printed(form, passes) -> None:
    """The pattern reaches the border."""
    with Driver(MODEL, nx=7, ny=6).start({**COARSE, "form": form, "passes": passes}) as fmu:
        for pattern in random_patterns(7, 6, 5):
            fmu.print_layer(pattern)
        drops = fmu.get("droplets_a") + fmu.get("droplets_b")
        assert fmu.get("volume_lost") > 0.0
        held = fmu.get("height").sum() * PITCH**2
        assert held + fmu.get("volume_lost") == pytest.approx(drops * VOLUME, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("points", [4, 7])
def test_droplet_is_even_about_the_middle_of_its_cell(points) -> None:
    pattern = np.zeros((5, 5), dtype=np.int32)
    pattern[2, 2] = 1
    with Driver(MODEL, nx=5, ny=5).start({"cells_per_pitch": points}) as fmu:
        height = fmu.print_layer(pattern)
    for turned in (height[::-1], height[:, ::-1]):
        np.testing.assert_allclose(turned, height, rtol=0.0, atol=1e-3 * height.max())


def test_fmu_prints_what_its_kernels_print() -> None:
    """Lines p, p + 4, ... in pass p, in the order of the rotation."""
    kernels = Print(9, 9, 4)
    with Driver(MODEL).start({**COARSE, "pass_rotation": 1}) as fmu:
        for number, pattern in enumerate(random_patterns(9, 9, 3), start=1):
            kernels.layer(pattern > 0, [((number + k) % 4, 4) for k in range(4)])
            assert fmu.print_layer(pattern) == pytest.approx(kernels.cells, rel=1e-9, abs=1e-15)
        assert fmu.get("fallbacks") == kernels.fallbacks


def test_droplets_smaller_than_the_spacing_lie_on_their_cells_and_are_counted_in_every_pass() -> None:
    """Their radius is 3.5 um, the points are 10.6 um apart; one of them in each of the four lines of a layer."""
    pattern = np.zeros((7, 9), dtype=np.int32)
    pattern[(0, 2, 4, 6), (1, 4, 7, 2)] = 1
    with Driver(MODEL, nx=7, ny=9).start({**COARSE, "droplet_volume": 1e-3 * VOLUME}) as fmu:
        for layer in (1, 2):
            height = fmu.print_layer(pattern)
            assert height == pytest.approx(layer * 1e-3 * VOLUME / PITCH**2 * pattern, rel=1e-9, abs=1e-20)
            assert fmu.get("fallbacks") == 4 * layer


def test_diagonal_order_prints_the_last_line_second() -> None:
    kernels = Print(9, 9, 4)
    kernels.layer(np.ones((9, 9)), [(0, 4), (3, 4), (1, 4), (2, 4)])
    with Driver(MODEL).start({**COARSE, "pass_order": 2}) as fmu:
        assert fmu.print_layer(np.ones((9, 9), dtype=np.int32)) == pytest.approx(kernels.cells, rel=1e-9, abs=0.0)


def test_one_pass_adds_what_each_line_would_print_alone() -> None:
    with Driver(MODEL, nx=5, ny=5).start({**COARSE, "passes": 1}) as fmu:
        together = fmu.print_layer(np.ones((5, 5), dtype=np.int32))
    alone = np.zeros((5, 5))
    for line in range(5):
        pattern = np.zeros((5, 5), dtype=np.int32)
        pattern[:, line] = 1
        with Driver(MODEL, nx=5, ny=5).start({**COARSE, "passes": 1}) as fmu:
            alone += fmu.print_layer(pattern)
    assert together == pytest.approx(alone, rel=1e-12, abs=0.0)


def test_two_drops_in_one_droplet_spread_like_one_of_twice_the_volume() -> None:
    pattern = np.zeros((5, 5), dtype=np.int32)
    pattern[2, 2] = 1
    with Driver(MODEL, nx=5, ny=5).start() as fmu:
        assert fmu.set("drop_level", 2) == OK
        levels = fmu.print_layer(pattern)
    with Driver(MODEL, nx=5, ny=5).start({"droplet_volume": 2.0 * VOLUME}) as fmu:
        assert fmu.print_layer(pattern) == pytest.approx(levels, rel=1e-12, abs=0.0)


def test_liquid_between_walls_does_not_gather_on_one_point() -> None:
    rng, pattern, height = np.random.default_rng(24), np.zeros((8, 5), np.int32), np.zeros((8, 5))
    height[1:7, 2:] = 150e-6 + rng.uniform(0.0, 250e-6, (6, 3))
    pattern[1:7, 2] = 1
    model = YoungLaplaceDeposition(form="nonlinear", contact_angle=np.pi / 4.0)
    before = model.start(height)
    after = model.layer(before, pattern)
    assert after.fallbacks == 1  # equation 3 has no solution there
    assert (after.over_grid - before.over_grid).max() < 300e-6  # a spike is 6 mm high


def test_droplet_that_spreads_too_far_is_refused() -> None:
    """Radius 35.2 um: 14 drops are the first that reach beyond two pitches of 42.3 um."""
    with Driver(MODEL, nx=5, ny=5).start() as fmu:
        assert max(fmu.set("drop_level", 14), fmu.set("layer_command", 1)) == OK
        before = fmu.save()
        assert fmu.step(0.0) == DISCARD
        assert "2 pitches" in fmu.messages[-1]
        assert fmu.save() == before
        bare, levels = np.ones((5, 5), dtype=np.int32), np.full((5, 5), 13, dtype=np.int32)
        bare[1, 2], levels[1, 2] = 0, 14  # that are not jetted
        assert max(fmu.set("pattern", bare), fmu.set("drop_level", levels), fmu.step(0.0)) == OK
        assert fmu.get("layers_printed") == 1
        assert max(fmu.set("volume_factor", 1.1), fmu.set("layer_command", 2)) == OK
        assert fmu.step(1.0) == DISCARD, "13 drops of 1.1 each are more than 14"
    with Driver(MODEL, nx=5, ny=5).start({"layer_period": 1.0, "drop_level": 14}) as fmu:
        assert fmu.step(0.0) == DISCARD
        assert "the largest droplet of the pattern spreads to a radius of 8.4" in fmu.messages[-1]
    with Driver(MODEL, nx=5, ny=5) as fmu:
        assert max(fmu.set("pitch", 17e-6), fmu.enter()) == OK
        assert fmu.exit() == ERROR
        assert max(fmu.set("contact_angle", 1.3), fmu.exit()) == OK


def test_state_of_other_parameters_brings_its_own_fine_surface() -> None:
    pattern = np.ones((4, 4), dtype=np.int32)
    with Driver(MODEL, nx=4, ny=4).start({"cells_per_pitch": 6}) as fine, Driver(MODEL, nx=4, ny=4) as other:
        unborn = other.save()
        other.start({"cells_per_pitch": 3})
        fine.print_layer(pattern)
        assert other.restore(fine.save()) == OK
        other.now = fine.now
        assert np.array_equal(other.print_layer(pattern), fine.print_layer(pattern))
        assert other.restore(unborn) == OK
        assert other.save() == unborn


def test_memory_that_does_not_fit_is_refused_at_the_end_of_the_configuration() -> None:
    with Driver(MODEL, nx=6, ny=5) as fmu, less_memory(500_000_000):
        assert max(fmu.call("enterConfigurationMode"), fmu.set("nx", 3000), fmu.set("ny", 700)) == OK
        assert fmu.call("exitConfigurationMode") == ERROR
        assert "no memory for 24036 x 5636 points of the fine surface, 64 a cell" in fmu.messages[-1]
        assert "fewer cells_per_pitch or a smaller grid" in fmu.messages[-1]
        assert max(fmu.set("nx", 6), fmu.set("ny", 5), fmu.call("exitConfigurationMode")) == OK
        assert max(fmu.set("cells_per_pitch", 2), fmu.enter(), fmu.exit()) == OK
        assert fmu.print_layer(np.ones((6, 5), dtype=np.int32)).max() > 0.0


def test_memory_that_does_not_fit_is_refused_by_fmi_2_at_the_end_of_initialization() -> None:
    """Its grid is fixed, so that only `cells_per_pitch` asks for more."""
    with Driver(MODEL, "fmi2") as fmu:
        assert max(fmu.set("cells_per_pitch", 64), fmu.enter()) == OK
        with less_memory(100_000_000):
            assert fmu.exit() == ERROR
            assert "no memory for 836 x 836 points of the fine surface, 4096 a cell" in fmu.messages[-1]
            assert "fewer cells_per_pitch" in fmu.messages[-1]
        assert max(fmu.set("cells_per_pitch", 2), fmu.exit()) == OK
        assert fmu.print_layer(np.ones((9, 9), dtype=np.int32)).max() > 0.0


@contextmanager
def less_memory(size: int) -> Iterator[None]:
    """At most so many more bytes of address space for this process."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def test_square_of_ten_layers_has_the_recorded_shape() -> None:
    """25 x 25 droplets, 42.3 um apart, nonlinear, recorded with another solver at 2.6 um: inner 15 x 15 droplets
    186 um, end walls 150 um wide (10 to 90 %) at 45 degrees, side walls at 79 degrees, a ridge of 203 um next to them,
    corner droplet 82 um, less than 0.5 % of the volume outside the nominal square."""
    square = Print(29, 29, 6)
    for _ in range(10):
        square.layer(middle(29, 29))
    um, n = square.height * 1e6, square.per_pitch
    rim = square.rim
    assert square.cells[7:22, 7:22].mean() * 1e6 == pytest.approx(186.0, rel=0.01, abs=0.0)
    sites = um[rim + n // 2 - 1 :, rim + n // 2 - 1 :][: 29 * n : n, : 29 * n : n]
    corners = sites[[2, 2, 26, 26], [2, 26, 2, 26]]
    assert corners.mean() == pytest.approx(82.0, rel=0.05, abs=0.0)
    assert sites[7:22].mean(axis=0).max() == pytest.approx(203.0, rel=0.02, abs=0.0)
    inner = slice(rim + 7 * n, rim + 22 * n)
    width, angle = wall(um[:, inner].mean(axis=1), square.spacing * 1e6)
    assert width == pytest.approx(150.0, rel=0.05, abs=0.0)
    assert angle == pytest.approx(45.0, rel=0.05, abs=0.0)
    assert wall(um[inner].mean(axis=0), square.spacing * 1e6)[1] == pytest.approx(79.0, rel=0.02, abs=0.0)
    nominal = slice(rim + 2 * n, rim + 27 * n)
    assert 1.0 - um[nominal, nominal].sum() / um.sum() < 0.005


def wall(profile, spacing: float) -> tuple[float, float]:
    """Width from 10 to 90 % of the top [um] and mean angle [degrees] of the wall where a profile begins."""
    half = profile[: len(profile) // 2]
    top, rising = half.max(), half[: half.argmax() + 1]
    low, high = (np.interp(share * top, rising, np.arange(len(rising)) * spacing) for share in (0.1, 0.9))
    return float(high - low), float(np.degrees(np.arctan2(0.8 * top, high - low)))
