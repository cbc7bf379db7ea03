"""Areal parameters equal closed forms, do not depend on where and how a map lies, and count measured cells only."""

from __future__ import annotations

import json
from math import isnan, pi, sin, sqrt, tan
from pathlib import Path

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.errors import HeightMapError
from inkloop.metrology.areal import Areal, FOperation, areal, values
from inkloop.metrology.height_map import HeightMap

A, STEP, PERIOD = 2e-6, 1e-5, 40


def map_of(z: np.ndarray, dx: float = STEP, dy: float = STEP) -> HeightMap:
    return HeightMap(z, dx, dy, source="test")


def wave(cells: int = 2 * PERIOD, rows: int = 11) -> np.ndarray:
    return np.repeat(A * np.sin(2 * pi * np.arange(cells) / PERIOD)[:, None], rows, axis=1)


def rough(shape: tuple[int, int] = (24, 17)) -> np.ndarray:
    return np.random.default_rng(2).normal(0.0, 3e-6, shape).cumsum(axis=0)


def check_same(one: Areal, other: Areal, rel: float = 1e-9) -> None:
    assert values(one) == pytest.approx(values(other), rel=rel, abs=0.0)


def test_a_sinusoid_has_its_closed_forms() -> None:
    """Sampled exactly: sum |sin| over a period of n is 2 cot(pi / n); neighbours differ by 2 sin(pi / n) cos(...)."""
    found = areal(map_of(wave()), f_operation="mean")
    assert found.Sa == pytest.approx(2.0 * A / (PERIOD * tan(pi / PERIOD)), rel=1e-12, abs=0.0)
    assert found.Sq == pytest.approx(A / sqrt(2.0), rel=1e-12, abs=0.0)
    assert (found.Sp, found.Sv, found.Sz) == pytest.approx((A, A, 2.0 * A), rel=1e-12, abs=0.0)
    assert found.Ssk == pytest.approx(0.0, abs=1e-12)
    assert found.Sku == pytest.approx(1.5, rel=1e-12, abs=0.0)
    whole = areal(map_of(wave(2 * PERIOD + 1)), f_operation="mean")  # whole periods of differences
    assert whole.Sdq == pytest.approx(A / STEP * 2.0 * sin(pi / PERIOD) / sqrt(2.0), rel=1e-12, abs=0.0)


def test_gradients_converge_to_those_of_the_smooth_sinusoid() -> None:
    """Sdq = 2 pi A / (sqrt(2) length); Sdr is the mean of sqrt(1 + z'^2) - 1, integrated here."""
    amplitude, length, cells = 5e-5, 4e-4, 400
    x = np.arange(cells + 1) * length / cells
    z = np.repeat(amplitude * np.sin(2 * pi * x / length)[:, None], 3, axis=1)
    found = areal(map_of(z, length / cells, 1e-3), f_operation="mean")
    slope = 2 * pi * amplitude / length
    fine = np.linspace(0.0, 2 * pi, 100_000, endpoint=False)
    assert found.Sdq == pytest.approx(slope / sqrt(2.0), rel=1e-4, abs=0.0)
    assert found.Sdr == pytest.approx(np.mean(np.sqrt(1 + (slope * np.cos(fine)) ** 2) - 1), rel=1e-4, abs=0.0)


def test_a_tilted_plane_is_its_slope_and_vanishes_by_the_plane() -> None:
    i, j = np.indices((12, 9))
    z = 0.3 * STEP * i - 0.4 * 2 * STEP * j
    tilted = areal(map_of(z, STEP, 2 * STEP), f_operation="mean")
    assert tilted.Sdq == pytest.approx(0.5, rel=1e-12, abs=0.0)
    assert tilted.Sdr == pytest.approx(sqrt(1.25) - 1.0, rel=1e-12, abs=0.0)
    flat = areal(map_of(z, STEP, 2 * STEP), f_operation="plane")
    assert (flat.Sa, flat.Sq, flat.Sz) == (0.0, 0.0, 0.0)
    assert isnan(flat.Ssk)
    assert isnan(flat.Sku)
    assert flat.Sdq == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.7])
def test_two_levels_have_their_closed_forms(share: float) -> None:
    """A share q of the cells one step h higher."""
    z = np.zeros((10, 10))
    z.flat[: round(share * 100)] = A
    found, spread = areal(map_of(z), f_operation="mean"), share * (1.0 - share)
    assert found.Sa == pytest.approx(2.0 * A * spread, rel=1e-12, abs=0.0)
    assert found.Sq == pytest.approx(A * sqrt(spread), rel=1e-12, abs=0.0)
    assert (found.Sp, found.Sv) == pytest.approx((A * (1.0 - share), A * share), rel=1e-12, abs=0.0)
    assert found.Ssk == pytest.approx((1.0 - 2.0 * share) / sqrt(spread), rel=1e-9, abs=1e-12)
    assert found.Sku == pytest.approx((1.0 - 3.0 * spread) / spread, rel=1e-9, abs=0.0)


def test_a_single_tip_has_the_area_of_its_pyramid() -> None:
    """Of height h on four squares: in each of them, half of the diagonals cut the tip off on two flanks of slope h."""
    z = np.zeros((9, 9))
    z[4, 4] = STEP
    found = areal(map_of(z), f_operation="mean")
    triangles = [1.0, 2.0, 1.0, 0.0]  # |grad z|^2 of the four triangles of a square at the tip
    assert found.Sdq == pytest.approx(sqrt(4 * sum(triangles) / 4 / 64), rel=1e-12, abs=0.0)
    assert found.Sdr == pytest.approx(4 * sum(sqrt(1 + g) - 1 for g in triangles) / 4 / 64, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("f_operation", ["mean", "plane"])
def test_offset_mirror_and_quarter_turn_change_nothing(f_operation: FOperation) -> None:
    z = rough()
    z[3, 5] = np.nan
    reference = areal(map_of(z, 2e-5, 3e-5), f_operation=f_operation)
    for other in (z + 1e-4, z[::-1], z[:, ::-1]):
        check_same(areal(map_of(other, 2e-5, 3e-5), f_operation=f_operation), reference)
    check_same(areal(map_of(np.rot90(z), 3e-5, 2e-5), f_operation=f_operation), reference)


def test_lengths_scale_and_ratios_stay() -> None:
    """In another unit of length in all three directions."""
    one, other = areal(map_of(rough())), areal(map_of(rough() * 1e3, STEP * 1e3, STEP * 1e3))
    lengths = ("Sa", "Sq", "Sp", "Sv", "Sz")
    scaled = {name: value * (1e3 if name in lengths else 1.0) for name, value in values(one).items()}
    assert values(other) == pytest.approx(scaled, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("f_operation", ["mean", "plane"])
def test_a_mask_is_the_same_cells_cut_out(f_operation: FOperation) -> None:
    """And cells without a height are the same as cells outside the mask."""
    z, mask = rough(), np.zeros((24, 17), bool)
    mask[4:15, 3:12] = True
    cut = areal(map_of(z[4:15, 3:12]), f_operation=f_operation)
    check_same(areal(map_of(z), mask, f_operation), cut)
    check_same(areal(map_of(np.where(mask, z, np.nan)), mask, f_operation), cut)


def test_cells_without_a_height_are_left_out() -> None:
    z = rough()
    holes = np.random.default_rng(4).random(z.shape) < 0.1
    found = areal(map_of(np.where(holes, np.nan, z)), f_operation="mean")
    heights = z[~holes] - z[~holes].mean()
    assert (found.cells, found.missing) == (int((~holes).sum()), int(holes.sum()))
    assert found.Sq == pytest.approx(heights.std(), rel=1e-12, abs=0.0)
    assert (found.Sp, found.Sv) == pytest.approx((heights.max(), -heights.min()), rel=1e-12, abs=0.0)


@pytest.mark.parametrize(("f_operation", "detrending"), [("mean", "center"), ("plane", "height")])
def test_surface_topography_agrees_on_a_rectangle(f_operation: FOperation, detrending: str) -> None:
    from SurfaceTopography import Topography

    z = np.pad(rough((40, 30)), ((0, 1), (0, 1)), mode="wrap")  # its gradients are those of one triangle a square
    other = Topography(z, physical_sizes=(41 * STEP, 31 * STEP), unit="m").detrend(detrending)
    found = areal(map_of(z), f_operation=f_operation)
    assert found.Sq == pytest.approx(other.rms_height_from_area(), rel=1e-9, abs=0.0)
    assert found.Sdq == pytest.approx(other.rms_gradient(), rel=1e-9, abs=0.0)


def test_too_little_to_evaluate_is_refused() -> None:
    z = rough()
    with pytest.raises(HeightMapError, match="49 cells have a height; needs 50"):
        areal(map_of(z[:7, :7]))
    holes = np.where(np.arange(17) % 4 == 0, np.nan, z)
    with pytest.raises(HeightMapError, match="of 408 cells have no height; at most 20% may lack one"):
        areal(map_of(holes))
    with pytest.raises(HeightMapError, match="mask"):
        areal(map_of(z), np.ones((3, 3), bool))
    with pytest.raises(HeightMapError, match="one line"):
        areal(map_of(wave(60, 1)))
    assert isnan(areal(map_of(wave(60, 1)), f_operation="mean").Sdq)


def test_the_command_evaluates_a_map_under_a_mask(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    z, mask = rough(), np.zeros((24, 17), np.uint8)
    mask[4:15, 3:12] = 1
    np.save(tmp_path / "map.npy", z * 1e6)
    np.save(tmp_path / "mask.npy", mask)
    command = ["metrology", str(tmp_path / "map.npy"), "--unit", "um", "--pixel-um", "10"]
    assert main([*command, "--mask", str(tmp_path / "mask.npy"), "--json"]) == 0
    shown = capsys.readouterr()
    found, expected = json.loads(shown.out), areal(map_of(z), mask > 0)
    assert found["Sa_um"] == pytest.approx(expected.Sa * 1e6, rel=1e-9, abs=0.0)
    assert found["Sdr"] == pytest.approx(expected.Sdr, rel=1e-9, abs=0.0)
    assert (found["cells"], found["f_operation"]) == (99, "plane")
    assert "root mean square gradient" in shown.err
    for wrong, message in (
        (["--mask", "part"], "only a run knows its part"),
        (["--mask", str(tmp_path / "none.npy")], "is no mask that can be read"),
        (["--layer", "1"], "leave --layer out"),
    ):
        assert main([*command, *wrong]) == 1
        assert message in capsys.readouterr().err
