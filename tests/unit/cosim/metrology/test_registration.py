"""A fine map on a grid of cells: means are kept, invalid pixels stay out, known places are found again."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from inkloop.component import Ink, Job
from inkloop.errors import HeightMapError
from inkloop.metrology.datum import level, plane, reference_cells
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_fit import _points, fit_to_surface
from inkloop.metrology.placement import Placement
from inkloop.metrology.registration import CellMeans, Registration, _box, cell_means, from_fiducials
from inkloop.units import M_PER_UM
from support.examples import examples
from support.fine_maps import covering, fine_map

PITCH = 263.256e-6


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
@pytest.mark.parametrize("mirror", ["none", "x", "y"])
@pytest.mark.parametrize(("a", "b"), [(1, 1), (6, 6), (4, 7)])
def test_aligned_pixels_that_divide_a_cell_give_its_exact_mean(a: int, b: int, mirror: str, turns: int) -> None:
    """Rectangular pixels, each orientation that a file may have."""
    nx, ny = 5, 4
    z = np.random.default_rng(3).random((nx * a, ny * b))
    dx, dy = PITCH / a, PITCH / b
    expected = z.reshape(nx, a, ny, b).mean(axis=(1, 3))
    if mirror != "none":
        expected = np.flip(expected, 0 if mirror == "x" else 1)
    expected = np.rot90(expected, -turns, axes=(1, 0))
    flat = Registration(0.0, 0.0, turns * math.pi / 2, mirror=mirror)  # type: ignore[arg-type]
    corners = flat.to_grid(np.array([0.0, (nx * a - 1) * dx]), np.array([0.0, (ny * b - 1) * dy]))
    pixel = (dx, dy) if turns % 2 == 0 else (dy, dx)
    offset = [float(side / 2 - PITCH / 2 - corner.min()) for side, corner in zip(pixel, corners, strict=True)]
    placed = Registration(offset[0], offset[1], turns * math.pi / 2, mirror=mirror)  # type: ignore[arg-type]
    cells = cell_means(HeightMap(z, dx, dy), placed, *expected.shape, PITCH)  # type: ignore[call-arg]
    np.testing.assert_allclose(cells.mean, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(cells.share, 1.0, rtol=0, atol=1e-9)


@settings(max_examples=examples(25))
@given(
    rotation=st.floats(-math.pi, math.pi),
    u=st.floats(-PITCH, PITCH),
    v=st.floats(-PITCH, PITCH),
    pixel=st.sampled_from([9e-6, 20e-6, 70e-6]),
)
def test_mean_height_is_kept_wherever_the_map_lies(rotation: float, u: float, v: float, pixel: float) -> None:
    """A smooth surface of 10 um: each cell's mean as by integration; the error grows by the square of a pixel."""
    nx, ny = 6, 5
    registration, shape = covering(nx, ny, PITCH, pixel, rotation, 1.5 * PITCH)
    registration = Registration(registration.offset_x + u, registration.offset_y + v, rotation)
    pixels = [np.arange(cells, dtype=np.float64) * pixel for cells in shape]
    x, y = registration.to_grid(pixels[0][:, None], pixels[1])
    wave = 2e-3
    waves = HeightMap(10 * M_PER_UM * np.sin(x / wave * 6) * np.cos(y / wave * 5), pixel, pixel)
    cells = cell_means(waves, registration, nx, ny, PITCH)
    i, j = np.arange(nx)[:, None] * PITCH, np.arange(ny) * PITCH
    damped = math.prod(math.sin(half) / half for half in (6 / wave * PITCH / 2, 5 / wave * PITCH / 2))
    exact = 10 * M_PER_UM * np.sin(i / wave * 6) * np.cos(j / wave * 5) * damped
    np.testing.assert_allclose(cells.mean, exact, rtol=0, atol=0.3 * M_PER_UM * (pixel / 70e-6) ** 2 + 0.002 * M_PER_UM)
    assert cells.share.min() > 0.98


@settings(max_examples=examples(25))
@given(seed=st.integers(0, 1000), rotation=st.floats(-0.1, 0.1), holes=st.floats(0.05, 0.9))
def test_invalid_pixels_never_leak_into_cells(seed: int, rotation: float, holes: float) -> None:
    """Where the surface is 1, every cell that is seen at all is 1; shares show what was measured."""
    rng = np.random.default_rng(seed)
    registration, shape = covering(6, 5, PITCH, 25e-6, rotation, PITCH)
    z = np.where(rng.random(shape) < holes, np.nan, 1.0)
    z[: shape[0] * 2 // 5, : shape[1] * 2 // 5] = np.inf
    cells = cell_means(HeightMap(z, 25e-6, 25e-6), registration, 6, 5, PITCH)
    valid = cells.valid(0.02)
    assert np.isfinite(cells.mean[valid]).all()
    np.testing.assert_allclose(cells.mean[cells.share > 0], 1.0, rtol=1e-12)
    assert not valid[0, 0]
    pixels = 2 * (PITCH / 25e-6) ** 2
    spread = math.sqrt(holes * (1.0 - holes) / pixels)
    assert cells.share[4:, 4:].mean() == pytest.approx(1.0 - holes, abs=6 * spread)


def test_cells_outside_the_map_are_not_measured_and_pixels_larger_than_cells_are_refused() -> None:
    cells = cell_means(HeightMap(np.ones((39, 39)), 30e-6, 30e-6), Registration(), 30, 30, PITCH)
    assert np.isnan(cells.mean[5:, 5:]).all()
    assert not cells.share[5:, 5:].any()
    assert cells.share[0, 0] == pytest.approx((PITCH / 2 + 15e-6) ** 2 / PITCH**2, rel=1e-9, abs=0.0)
    for dx, dy in ((300e-6, 30e-6), (30e-6, 300e-6)):
        with pytest.raises(HeightMapError, match=r"a pixel is 300 µm on the grid, a cell 263\.3 µm"):
            cell_means(HeightMap(np.ones((9, 9)), dx, dy), Registration(), 5, 5, PITCH)
    same = PITCH * (1.0 + 1e-9)
    assert cell_means(HeightMap(np.ones((4, 4)), same, same), Registration(), 4, 4, PITCH).share.min() > 0.999
    z = np.full((40, 40), np.nan)
    z[33, 25] = 2.0  # a four hundredth of the cell of which it is a pixel
    found = cell_means(HeightMap(z, PITCH / 20, PITCH / 20), Registration(), 3, 3, PITCH)
    assert np.argwhere(np.isfinite(found.mean)).tolist() == [[2, 1]]
    assert found.share[2, 1] == pytest.approx(1 / 400, rel=1e-6, abs=0.0)


@settings(max_examples=examples(50))
@given(
    rotation=st.floats(-3.1, 3.1),
    offset=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
    mirror=st.sampled_from(["none", "x", "y"]),
    count=st.integers(2, 6),
)
def test_fiducials_find_the_registration_again(
    rotation: float, offset: tuple[float, float], mirror: str, count: int
) -> None:
    truth = Registration(*offset, rotation, mirror)  # type: ignore[arg-type]
    on_map = np.random.default_rng(count).random((count, 2)) * 5e-3
    on_grid = np.stack(truth.to_grid(on_map[:, 0], on_map[:, 1]), axis=1)
    found = from_fiducials(on_map, on_grid, mirror=mirror, residual_max=1e-12)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.to_grid(on_map[:, 0], on_map[:, 1]), on_grid.T, atol=1e-12)


def test_first_pixel_has_its_place() -> None:
    map_ = HeightMap(np.random.default_rng(5).random((12, 10)), PITCH / 2, PITCH / 2)
    moved = replace(map_, x0=2 * PITCH, y0=PITCH)
    found, expected = (
        cell_means(moved, Registration(), 9, 8, PITCH),
        cell_means(map_, Registration(2 * PITCH, PITCH), 9, 8, PITCH),
    )
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-9)
    np.testing.assert_allclose(found.share, expected.share, rtol=1e-9, atol=1e-9)


def test_map_of_many_pixels_keeps_its_means() -> None:
    side, rows = 4, 600
    z = np.arange(rows, dtype=np.float64)[:, None] + np.zeros(rows)
    registration = Registration(PITCH / side / 2 - PITCH / 2, PITCH / side / 2 - PITCH / 2)
    found = cell_means(HeightMap(z, PITCH / side, PITCH / side), registration, rows // side, 3, PITCH)
    np.testing.assert_allclose(found.mean, z.reshape(rows // side, side, rows).mean(axis=1)[:, :3], rtol=1e-9)


def test_share_that_is_the_least_one_is_enough() -> None:
    assert CellMeans(np.ones((1, 2)), np.array([[0.5, 0.49]])).valid(0.5).tolist() == [[True, False]]


def test_eleven_places_are_too_few_for_a_fit() -> None:
    with pytest.raises(HeightMapError, match="11 places were measured; too few"):
        fit_to_surface(HeightMap(np.eye(11)[:, :1], PITCH, PITCH), np.eye(4), PITCH, Registration(), reach=PITCH)


def test_residual_of_fiducials_is_their_distance() -> None:
    """Three on a line, the middle one off by 3 um: the line shifts by 1 um, and 2, 1, 1 um are left."""
    on_map = [[0.0, 0.0], [1e-3, 0.0], [2e-3, 0.0]]
    on_grid = [[0.0, 0.0], [1e-3, 3e-6], [2e-3, 0.0]]
    from_fiducials(on_map, on_grid, residual_max=1.415e-6)
    with pytest.raises(HeightMapError, match=r"leaves 1.41 µm rms, 1 µm are allowed; check that they are given"):
        from_fiducials(on_map, on_grid, residual_max=1e-6)
    from_fiducials(on_map, on_map, residual_max=0.0)
    corner, other = [[0.0, 0.0], [1e-3, 0.0], [0.0, 1e-3]], [[0.0, 0.0], [1e-3, 0.0], [0.0, -4e-4]]
    with pytest.raises(HeightMapError, match=r"check that they are given in the same order and in the same unit$"):
        from_fiducials(corner, other, residual_max=1e-6)


@pytest.mark.parametrize(
    ("on_map", "on_grid", "message"),
    [
        ([[0.0, 0.0]], [[0.0, 0.0]], "two or more points"),
        ([[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0]], "two or more points"),
        ([[1.0, 1.0], [1.0, 1.0]], [[0.0, 0.0], [1.0, 0.0]], "all lie on one point of the map"),
        ([[1.0, 1.0], [math.nan, 1.0]], [[0.0, 0.0], [1.0, 0.0]], "not finite"),
    ],
)
def test_degenerate_fiducials_are_refused(on_map: list[list[float]], on_grid: list[list[float]], message: str) -> None:
    with pytest.raises(HeightMapError, match=message):
        from_fiducials(on_map, on_grid, residual_max=1.0)


def block() -> np.ndarray:
    """A part on a grid of 20 x 18 cells, without symmetry."""
    surface = np.zeros((20, 18))
    surface[4:14, 3:15] = 8 * M_PER_UM
    surface[12:14, 10:15] = 0.0
    return surface


def measured(truth: Registration, rng: np.random.Generator, noise: float = 0.3 * M_PER_UM) -> HeightMap:
    """The block under a tilted profiler with noise, spikes, a hole and missing pixels."""
    fine = fine_map(block(), PITCH, truth, (640, 600), 9e-6)
    x, y = np.indices(fine.shape) * 9e-6
    z = fine.z + noise * rng.standard_normal(fine.shape) + 2e-3 * x - 1e-3 * y + 40 * M_PER_UM
    z[rng.random(fine.shape) < 0.002] = 300 * M_PER_UM
    z[rng.random(fine.shape) < 0.1] = np.nan
    z[200:260, 100:200] = np.nan
    return HeightMap(z, 9e-6, 9e-6, source="scan.tif")


def missed(found: Registration, truth: Registration) -> float:
    """Distance of two registrations in the middle of the block [m]."""
    middle = np.array(2.9e-3), np.array(2.7e-3)
    return float(np.abs(np.subtract(found.to_grid(*middle), truth.to_grid(*middle))).max())


@pytest.mark.parametrize(("u", "v", "turn_deg"), [(0.0, 0.0, 0.0), (1.7, -2.4, 1.2), (-0.3, 0.45, -1.6)])
def test_fit_finds_a_known_shift_and_turn(u: float, v: float, turn_deg: float) -> None:
    start = Registration(-0.2e-3, -0.3e-3, 0.05)
    truth = Registration(start.offset_x + u * PITCH, start.offset_y + v * PITCH, 0.05 + math.radians(turn_deg))
    scan, turn = measured(truth, np.random.default_rng(2)), math.radians(2)
    fit = fit_to_surface(scan, block(), PITCH, start, reach=3 * PITCH, rotation_reach=turn)
    assert missed(fit.registration, truth) < 0.01 * PITCH
    assert 0.0 < fit.offset_std < 0.02 * PITCH
    assert fit.registration.rotation == pytest.approx(truth.rotation, abs=math.radians(0.05))
    assert fit.explained > 0.7


@pytest.mark.parametrize("turned", [False, True])
def test_fit_begins_where_the_search_found_the_part(turned: bool) -> None:
    """Of ribs no slope of the residuals leads over the gap between two of them."""
    ribs, cells = np.zeros((20, 18)), (0.2, -2.1)
    for begin, end in ((3, 4), (5, 7), (9, 10), (12, 14), (15, 16)):
        ribs[4:16, begin:end] = 8 * M_PER_UM
    surface, (u, v) = (ribs.T, cells[::-1]) if turned else (ribs, cells)
    scan = fine_map(surface, PITCH, Registration(u * PITCH, v * PITCH), (160, 160), 36e-6)
    found = fit_to_surface(scan, surface, PITCH, Registration(), reach=3 * PITCH).registration
    assert (found.offset_x, found.offset_y) == pytest.approx((u * PITCH, v * PITCH), abs=0.06 * PITCH)


@pytest.mark.parametrize("softness", [0.0, 0.2, 0.35])
def test_fit_is_not_led_astray_by_soft_flanks_that_are_seen_in_part(softness: float) -> None:
    """Where ink runs, flanks are soft, and where they are steepest little light comes back."""
    truth = Registration(0.4 * PITCH, -0.7 * PITCH, 0.02)
    soft = gaussian_filter(np.kron(block(), np.ones((12, 12))), 12 * softness)
    fine = fine_map(soft, PITCH / 12, replaced_origin(truth), (640, 600), 9e-6)
    steep = np.hypot(*np.gradient(fine.z, 9e-6)) > 0.02
    seen = HeightMap(np.where(steep & (np.random.default_rng(6).random(fine.shape) < 0.6), np.nan, fine.z), 9e-6, 9e-6)
    fit = fit_to_surface(seen, block(), PITCH, Registration(), reach=2 * PITCH, rotation_reach=math.radians(2))
    assert missed(fit.registration, truth) < 0.01 * PITCH
    assert fit.registration.rotation == pytest.approx(truth.rotation, abs=math.radians(0.1))


def replaced_origin(registration: Registration) -> Registration:
    """The same place on a grid of twelfths, whose origin is the centre of its own first cell."""
    shift = (PITCH - PITCH / 12) / 2
    return Registration(registration.offset_x + shift, registration.offset_y + shift, registration.rotation)


def test_fit_that_may_not_turn_keeps_the_rotation_that_it_was_given() -> None:
    truth = Registration(0.4 * PITCH, -0.7 * PITCH, 0.02)
    start = Registration(rotation=0.02)
    fit = fit_to_surface(measured(truth, np.random.default_rng(4)), block(), PITCH, start, reach=2 * PITCH)
    assert fit.registration.rotation == 0.02
    assert missed(fit.registration, truth) < 0.01 * PITCH


def test_place_is_as_uncertain_as_it_is_where_fewest_edges_tell_it() -> None:
    """A bar has as few edges across y as a square of its width, and many more across x."""
    deviations = []
    for cells in (10, 4):
        surface = np.zeros((20, 18))
        surface[7:11, 4 : 4 + cells] = 8 * M_PER_UM
        fine = fine_map(surface, PITCH, Registration(), (160, 150), 36e-6)
        noise = M_PER_UM * np.random.default_rng(3).standard_normal(fine.shape)
        scan = HeightMap(fine.z + noise, fine.dx, fine.dy)
        deviations.append(fit_to_surface(scan, surface, PITCH, Registration(), reach=PITCH).offset_std)
    assert deviations[0] == pytest.approx(deviations[1], rel=0.15, abs=0.0)


@pytest.mark.parametrize(("u", "v"), [(4.6, 0.0), (0.0, -4.6)])
def test_fit_beyond_its_reach_and_to_a_flat_surface_is_refused(u: float, v: float) -> None:
    scan = measured(Registration(u * PITCH, v * PITCH), np.random.default_rng(3))
    with pytest.raises(HeightMapError, match="correct offset and rotation, or search wider"):
        fit_to_surface(scan, block(), PITCH, Registration(), reach=2 * PITCH)
    with pytest.raises(HeightMapError, match="flat, so the position of the map is undetermined"):
        fit_to_surface(scan, np.ones((4, 4)), PITCH, Registration(), reach=PITCH)


def test_points_of_a_fit_lie_in_the_middle_of_their_tiles_whatever_the_pixels() -> None:
    """Pixels of 2 x 5 um in tiles of 10 um: five along x, two along y."""
    z = np.arange(60.0).reshape(10, 6)
    x, y, mean = _points(HeightMap(z, 2e-6, 5e-6), 10e-6)
    assert x.tolist() == pytest.approx([4e-6] * 3 + [14e-6] * 3, rel=1e-12, abs=0.0)
    assert y.tolist() == pytest.approx([2.5e-6, 12.5e-6, 22.5e-6] * 2, rel=1e-12, abs=0.0)
    assert mean.tolist() == z.reshape(2, 5, 3, 2).mean(axis=(1, 3)).ravel().tolist()


JOB = Job(10, 8, 250e-6, np.zeros((10, 8)), np.zeros((10, 8), np.bool_), (Ink(),))
JOB.mask[3:7, 2:6] = True
JOB.target_height[JOB.mask] = 3 * JOB.inks[0].layer_height


def fine(heights: Any) -> HeightMap:
    """Cells as 5 x 5 pixels each."""
    return HeightMap(np.kron(heights, np.ones((5, 5))), 50e-6, 50e-6, source="scan.csv")


AT_HOME = Registration(-100e-6, -100e-6)
"""Place of the first pixel of `fine`."""


def test_placed_map_says_how_much_of_the_part_it_shows() -> None:
    heights = np.arange(80.0).reshape(10, 8) * M_PER_UM
    heights[3, 2:4] = np.nan
    found = Placement(JOB, AT_HOME).place(fine(heights), 1)
    np.testing.assert_allclose(found.height, heights, rtol=1e-9)
    assert np.argwhere(~found.valid).tolist() == [[3, 2], [3, 3]]
    assert found.words == "88% of the part measured"
    heights[4:6] = np.nan
    with pytest.raises(HeightMapError, match=r"scan\.csv: 38% of the part's cells were measured; needs 50%"):
        Placement(JOB, AT_HOME).place(fine(heights), 1)
    heights[4, 2:4] = 1.0
    assert Placement(JOB, AT_HOME).place(fine(heights), 1).words == "50% of the part measured"
    z = np.zeros((50, 40))
    z[0, :], z[5:8, :] = np.nan, np.nan  # a fifth of the first row of cells, three fifths of the second
    for share_min, second in ((0.5, False), (0.39, True)):
        found = Placement(JOB, AT_HOME, share_min=share_min).place(HeightMap(z, 50e-6, 50e-6), 1)
        assert found.valid.all(axis=1).tolist() == [True, second] + [True] * 8
        np.testing.assert_array_equal(np.isfinite(found.height), found.valid)


def test_advice_names_the_places_of_map_and_grid() -> None:
    away = Registration(10e-3, 20e-3)
    with pytest.raises(HeightMapError) as raised:
        Placement(JOB, away).place(replace(fine(np.ones((10, 8))), x0=1e-3, y0=2e-3), 0)
    message = str(raised.value)
    assert "0% of the part's cells were measured; needs 50%" in message
    assert "Its field lies at x 11.00 to 13.50, y 22.00 to 24.00 mm, the grid at 0 to 2.50 and 0 to 2.00 mm" in message
    assert "100% of its pixels hold a height" in message


def test_map_is_fitted_to_the_layers_that_are_printed() -> None:
    layer = JOB.inks[0].layer_height
    shifted = replace(AT_HOME, offset_x=AT_HOME.offset_x + 100e-6, offset_y=AT_HOME.offset_y - 50e-6)
    placement = Placement(JOB, shifted, fit_reach=(300e-6, 0.0))
    printed = np.where(JOB.mask, 2 * layer, 0.0)
    found = placement.place(fine(printed), 2)
    np.testing.assert_allclose(found.height[JOB.mask], 2 * layer, atol=0.02 * layer)
    assert found.words.startswith("100% of the part measured, fitted to ")
    assert found.words.endswith("100% of its relief is the part's")
    flat = placement.place(fine(np.ones((10, 8)) * M_PER_UM), 0)  # of the start surface nothing can be fitted
    assert "fitted" not in flat.words


def test_map_of_a_staircase_is_fitted_to_the_steps_that_are_printed() -> None:
    """After the first layer all steps are equally high."""
    layer = JOB.inks[0].layer_height
    target = JOB.target_height.copy()
    target[5:7, 2:6] = layer
    placement = Placement(replace(JOB, target_height=target), AT_HOME, fit_reach=(300e-6, 0.0))
    words = placement.place(fine(np.where(JOB.mask, layer, 0.0)), 1).words
    assert words.endswith("100% of its relief is the part's")


def test_datum_leaves_out_as_many_cells_around_the_part_as_it_is_told() -> None:
    heights = np.where(reference_cells(JOB.mask, 2), 0.0, 30.0 * M_PER_UM)
    for margin, ground_um in ((1, 30.0), (2, 0.0)):
        found = Placement(JOB, AT_HOME, datum="offset", datum_margin=margin).place(fine(heights), 0)
        np.testing.assert_allclose(found.height, heights - ground_um * M_PER_UM, rtol=0.0, atol=1e-12)


def test_datum_is_the_median_or_the_plane_of_what_lies_around_the_part() -> None:
    i, j = np.indices((10, 8))
    ground = 3.0 + 0.25 * i - 0.5 * j
    reference = reference_cells(JOB.mask, 1)
    assert not reference[2:8, 1:7].any()
    assert reference.sum() == 80 - 36
    assert reference_cells(JOB.mask, 0).sum() == 80 - 16
    height = (ground + 20.0 * JOB.mask) * M_PER_UM
    height[0, 0] += 50e-6  # dirt
    np.testing.assert_allclose(level(height, reference, "plane")[JOB.mask], 20e-6, rtol=1e-9)
    assert not plane(height, reference)[1][0, 0]
    np.testing.assert_array_equal(level(height, reference, "none"), height)
    offset = level(height, reference, "offset")
    np.testing.assert_allclose(height - offset, np.median(height[reference]), rtol=1e-9)
    few = np.zeros(reference.shape, np.bool_)
    few[0, :7] = True
    with pytest.raises(HeightMapError, match="7 cells outside the part were measured, the plane needs 8"):
        level(height, few, "plane")
    few[0, 7] = True
    with pytest.raises(HeightMapError, match="lie on one line and define no plane"):
        level(height, few, "plane")
    with pytest.raises(HeightMapError, match="0 cells outside the part were measured, the offset needs 1"):
        level(height, few & False, "offset")


def test_dirt_is_told_by_the_ground_alone_also_where_the_part_is_most_of_the_map() -> None:
    ground = np.ones((10, 8), np.bool_)
    ground[1:-1, 1:-1] = False
    height = np.where(ground, 0.0, 20e-6)
    height[0, 0] = 50e-6  # dirt
    surface, used = plane(height, ground)
    assert np.argwhere(ground & ~used).tolist() == [[0, 0]]
    np.testing.assert_allclose((height - surface)[~ground], 20e-6, rtol=1e-9)


@pytest.mark.parametrize(("swap", "other"), [("none", "y"), ("y", "none"), ("x", "none")])
def test_fiducials_of_a_mirrored_map_are_recognised(swap: Any, other: str) -> None:
    on_map = np.array([[0.0, 0.0], [3e-3, 0.0], [0.0, 1e-3]])
    truth = Registration(1e-3, 2e-3, 0.4, mirror=other)  # type: ignore[arg-type]
    on_grid = np.stack(truth.to_grid(on_map[:, 0], on_map[:, 1]), axis=1)
    with pytest.raises(HeightMapError, match=f"with mirror = '{other}' it is .* µm: the map is mirrored"):
        from_fiducials(on_map, on_grid, mirror=swap, residual_max=1e-6)


@pytest.mark.parametrize("mirror", ["none", "x", "y"])
@pytest.mark.parametrize("turns", [0, 1, 2, -1])
def test_pixel_has_the_sides_on_the_grid_that_lie_between_its_neighbours(turns: int, mirror: Any) -> None:
    registration = Registration(3e-6, -2e-6, turns * math.pi / 2, mirror)
    map_ = HeightMap(np.zeros((3, 4)), 2e-6, 7e-6)
    x, y = registration.to_grid(np.array([0.0, map_.dx]), np.array([0.0, map_.dy]))
    assert _box(map_, registration) == pytest.approx((abs(x[1] - x[0]), abs(y[1] - y[0])), rel=1e-9, abs=0.0)
