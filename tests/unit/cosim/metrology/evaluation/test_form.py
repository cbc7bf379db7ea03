"""Flatness, parallelism, step height, outline and volume of bodies whose figures are known."""

from __future__ import annotations

from math import atan, degrees, pi, radians, sqrt, tan
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from inkloop.metrology.evaluation.definitions import Treatment, symbols
from inkloop.metrology.evaluation.form import CENTRE, central_third, minimax
from inkloop.metrology.evaluation.outline import least_squares_circle, minimum_zone_circle
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.surface import Found, s_filtered
from inkloop.metrology.evaluation.table import found
from inkloop.metrology.height_map import HeightMap
from support.evaluated import STEP, Map, check, check_same, map_of, number, reason, rough

H = 50e-6
RADIUS = 20.3 * STEP


def form(subject: Subject, **treatment: Any) -> Found:
    return found(subject, "form", Treatment(**treatment))


def frustum(angle_deg: float = 60.0, shape: tuple[int, int] = (70, 64)) -> tuple[Map, Map]:
    """Heights of a cone's frustum whose radius at half height is RADIUS, and its cells."""
    i, j = np.indices(shape)
    distance = np.hypot((i - 34.4) * STEP, (j - 31.7) * STEP)
    return np.clip((RADIUS - distance) * tan(radians(angle_deg)) + H / 2, 0.0, H), distance < RADIUS


def test_flatness_by_both_methods() -> None:
    """The plane of a dome k (x^2 + y^2) over a square is level by symmetry, and the zone is its whole height."""
    places = np.indices((31, 31)) - 15
    dome, i = 1e-9 * (places**2).sum(axis=0), places[0]
    level = form(Subject(map_of(dome + 1e-3 * i * STEP)))
    cosine = 1.0 / sqrt(1.0 + 1e-6)
    check(level, {"flatness_ls": 450e-9 * cosine, "flatness_mz": 450e-9 * cosine}, rel=1e-6)

    z = rough()
    terms = np.column_stack([np.ones(z.size), *np.indices(z.shape).reshape(2, -1)])
    factors, half = minimax(terms, z.ravel())
    uneven = form(Subject(map_of(z)))
    expected = 2.0 * half / sqrt(1.0 + (factors[1] ** 2 + factors[2] ** 2) / STEP**2)
    assert number(uneven, "flatness_mz") == pytest.approx(expected, rel=1e-6, abs=0.0)
    assert number(uneven, "flatness_mz") < number(uneven, "flatness_ls")


def test_a_tilted_top_is_flat_and_not_parallel() -> None:
    """A slope s over the width w of the top rises by s w above the substrate, which is tilted itself."""
    z, slope = np.zeros((60, 50)), 0.01
    mask = np.zeros(z.shape, bool)
    mask[15:45, 10:40] = True
    i = np.indices(z.shape)[0]
    z = np.where(mask, H + slope * i * STEP, 0.0) + 0.02 * i * STEP
    values = form(Subject(map_of(z), mask))
    cosine = 1.0 / sqrt(1.0 + 0.02**2)
    assert number(values, "flatness_ls") == pytest.approx(0.0, abs=1e-12)
    check(values, dict.fromkeys(("parallelism_ls", "parallelism_mz"), 29 * STEP * slope * cosine), rel=1e-6)


def test_a_step_on_tilted_ground_has_its_height() -> None:
    z, mask = frustum(89.9)
    start = np.tensordot([0.003 * STEP, -0.002 * STEP], np.indices(z.shape), axes=1)
    tilted = z + start
    values = form(Subject(map_of(tilted), mask))
    check(values, {"step_height_ls": H, "step_height_mz": H}, rel=1e-4)
    steep = np.tensordot([0.01 * STEP, -0.02 * STEP], np.indices(z.shape), axes=1)
    wall, _ = frustum()
    circle = form(Subject(map_of(wall + steep), mask))
    assert number(circle, "radius_ls") == pytest.approx(RADIUS, rel=2e-3, abs=0.0)
    assert number(circle, "roundness_ls") < 0.1 * STEP
    of_run = form(Subject(map_of(tilted), mask, target=np.where(mask, H, 0.0), start=start))
    check(of_run, {"step_height_ls": H}, rel=1e-4)


@pytest.mark.parametrize("angle_deg", [35.0, 60.0])
def test_a_frustum_has_its_wall_and_its_circle(angle_deg: float) -> None:
    z, mask = frustum(angle_deg)
    values = form(Subject(map_of(z), mask))
    for method in ("ls", "mz"):
        assert degrees(number(values, f"wall_angle_{method}")) == pytest.approx(angle_deg, abs=0.5)
        assert number(values, f"radius_{method}") == pytest.approx(RADIUS, rel=2e-3, abs=0.0)
        assert number(values, f"roundness_{method}") < 0.1 * STEP
    turned = form(Subject(map_of(np.rot90(z)), np.rot90(mask)))
    check_same(turned, values, rel=1e-6)
    check_same(form(Subject(map_of(z[::-1]), mask[::-1])), values, rel=1e-6)


def test_a_wall_that_cells_cannot_resolve_has_no_angle() -> None:
    z, mask = frustum(89.0)
    values = form(Subject(map_of(z), mask))
    assert f"steeper than {degrees(atan(0.6 * H / STEP)):.1f} deg" in reason(values, "wall_angle_ls")
    assert number(values, "radius_ls") == pytest.approx(RADIUS, rel=0.01, abs=0.0)


def test_an_oval_outline_has_its_roundness_and_a_square_is_no_circle() -> None:
    i, j = np.indices((80, 80))
    x, y = (i - 40) * STEP, (j - 40) * STEP
    distance = np.hypot(x / 1.05, y)
    z = np.clip((30 * STEP - distance) + H / 2, 0.0, H)
    oval = form(Subject(map_of(z), z > H / 2))
    check(oval, dict.fromkeys(("roundness_ls", "roundness_mz"), 1.5 * STEP), rel=0.03)
    check(oval, dict.fromkeys(("radius_ls", "radius_mz"), 30.75 * STEP), rel=5e-3)
    oblong = form(Subject(map_of(z[::4], 4 * STEP), z[::4] > H / 2))
    angle = np.linspace(0.0, 2 * pi, 100_000, endpoint=False)
    lengths = np.hypot(31.5 * np.sin(angle), 30.0 * np.cos(angle))
    radius = np.average(np.hypot(31.5 * np.cos(angle), 30.0 * np.sin(angle)), weights=lengths)  # along the outline
    assert "narrower than one pitch of 40 µm" in reason(oblong, "wall_angle_ls")
    assert number(oblong, "radius_ls") == pytest.approx(radius * STEP, rel=1.5e-3, abs=0.0)
    square = np.clip(20 * STEP - np.maximum(abs(x), abs(y)) + H / 2, 0.0, H)
    assert "is no circle" in reason(form(Subject(map_of(square), square > H / 2)), "radius_mz")


def test_the_minimum_zone_circle_is_the_best_of_all_centres() -> None:
    """Against a search of the plane on ever finer grids; the mean square has another centre."""
    rng = np.random.default_rng(9)
    for _ in range(4):
        angle = rng.uniform(0.0, 2 * pi, 9)
        points = (10.0 + rng.uniform(-0.8, 0.8, 9))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + (
            3.0,
            -7.0,
        )
        best, width, size = points.mean(axis=0), np.inf, 6.0
        for _ in range(40):
            grid = best + np.stack(np.meshgrid(*[np.linspace(-size, size, 21)] * 2), axis=-1).reshape(-1, 2)
            radii = np.hypot(*np.moveaxis(points - grid[:, None], -1, 0))
            zones = np.ptp(radii, axis=1)
            best, width, size = grid[np.argmin(zones)], float(zones.min()), size * 0.6
        centre, radius = minimum_zone_circle(points)
        radii = np.hypot(*(points - centre).T)
        assert np.ptp(radii) == pytest.approx(width, rel=1e-5, abs=0.0)
        assert radius == pytest.approx((radii.min() + radii.max()) / 2, rel=1e-12, abs=0.0)
        mean = least_squares_circle(points)[0]
        assert np.ptp(np.hypot(*(points - mean).T)) >= np.ptp(radii)


def test_the_least_squares_circle_is_exact_on_an_arc() -> None:
    angle = np.linspace(0.0, 2.0, 50)
    points = np.column_stack([5e-3 + 2e-3 * np.cos(angle), -1e-3 + 2e-3 * np.sin(angle)])
    centre, radius = least_squares_circle(points)
    assert centre == pytest.approx([5e-3, -1e-3], rel=1e-9, abs=0.0)
    assert radius == pytest.approx(2e-3, rel=1e-9, abs=0.0)


def test_form_that_is_not_there_is_refused() -> None:
    z, mask = frustum()
    around, bare = np.where(mask | (z > 0), 0.0, H), np.zeros_like(z)
    sloping = np.where(mask, H + np.indices(z.shape)[0] * 1e-6, 0.0)
    flat, gap = form(Subject(map_of(bare), mask)), z.copy()
    gap[33:36, 50:54] = np.nan  # on the wall
    assert "no outline without a step" in reason(flat, "wall_angle_mz")
    assert set(flat) == set(symbols("form"))
    for subject, symbol, words in (
        (Subject(map_of(bare), mask), "step_height_ls", "no step stands out"),
        (Subject(map_of(z)), "parallelism_ls", "0 cells with heights lie more than 2 cells outside the mask"),
        (Subject(map_of(z), mask, target=sloping), "step_height_mz", "the target is not flat"),
        (Subject(map_of(z), mask, target=np.where(mask, H + (sloping - H) / 100.0, 0.0)), "step_height_ls", "not flat"),
        (Subject(map_of(-z), mask), "step_height_mz", "no step stands out"),
        (Subject(map_of(z[15:]), mask[15:]), "radius_ls", "is not closed"),
        (Subject(map_of(gap), mask), "radius_mz", "is not closed"),
        (Subject(map_of(np.concatenate([z, z])), np.concatenate([mask, mask])), "wall_angle_ls", "has 2 pieces"),
        (Subject(map_of(z + around), mask, start=bare), "roundness_mz", "no wall is free"),
        (Subject(map_of(z - around), mask, start=bare), "radius_ls", "stand -50 µm above the substrate: no wall"),
        (Subject(map_of(z[:5, :5])), "flatness_ls", "25 cells have a height"),
    ):
        assert words in reason(form(subject), symbol)


def test_form_is_that_of_the_heights_after_the_s_filter() -> None:
    z, mask = frustum()
    z = z + np.where(mask, np.random.default_rng(4).normal(0.0, 1e-6, z.shape), 0.0)
    smooth = s_filtered(map_of(z), Treatment(s_filter=6 * STEP))
    assert isinstance(smooth, HeightMap)
    found, expected, rough_one = (
        form(Subject(map_, mask, start=np.zeros_like(z)), s_filter=cutoff)
        for map_, cutoff in ((map_of(z), 6 * STEP), (smooth, None), (map_of(z), None))
    )
    for symbol in ("flatness_ls", "flatness_mz", "parallelism_mz", "step_height_ls", "step_height_mz", "radius_ls"):
        assert number(found, symbol) == pytest.approx(number(expected, symbol), rel=1e-9, abs=0.0)
        assert number(found, symbol) != pytest.approx(number(rough_one, symbol), rel=1e-5, abs=0.0)


def test_one_wrong_height_beside_the_part_hides_no_wall() -> None:
    z, mask = frustum()
    z[0, 0] = -1.0
    assert number(form(Subject(map_of(z), mask, start=np.zeros_like(z))), "radius_ls") > 0.0


def test_a_substrate_needs_fifty_cells() -> None:
    z, mask = np.full((60, 40), np.nan), np.zeros((60, 40), bool)
    mask[12:42, 10:30] = True
    z[mask], z[50:55, 10:20] = H, 0.0
    check(form(Subject(map_of(z), mask)), {"step_height_ls": H}, rel=1e-9)
    z[50, 10] = np.nan
    assert reason(form(Subject(map_of(z), mask)), "step_height_ls").startswith("49 cells with heights lie more than 2")


def test_a_step_needs_fifty_cells_in_the_middle_of_its_top() -> None:
    """Of 15 x 20 cells those that are six or more from the edge: 5 x 10."""
    z, mask = np.zeros((40, 40)), np.zeros((40, 40), bool)
    mask[12:27, 10:30] = True
    z[mask] = H
    check(form(Subject(map_of(z), mask)), {"step_height_ls": H}, rel=1e-9)
    z[19, 20] = np.nan
    few = "49 cells with heights lie in the central third of the part; a step needs 50"
    assert reason(form(Subject(map_of(z), mask)), "step_height_ls") == few


def test_volumes_are_sums_and_their_error_is_target_minus_printed() -> None:
    z, mask = frustum()
    start, target = np.full_like(z, 1e-6), np.where(mask, H, 0.0)
    subject = Subject(map_of(z + start, STEP / 2, 2 * STEP), mask, target, start, droplets=40)
    values = found(subject, "volume")
    printed = z[mask].sum() * STEP**2
    wanted = (H - 1e-6) * mask.sum() * STEP**2
    expected = {"volume_printed": printed, "volume_target": wanted, "volume_error": wanted - printed, "droplets": 40.0}
    check(values, expected | {"droplet_volume": z.sum() * STEP**2 / 40}, rel=1e-9)
    cone = pi * H * (RADIUS**2 + (H / 2 / tan(radians(60))) ** 2 / 3)  # frustum with that radius at half height
    assert z.sum() * STEP**2 == pytest.approx(cone, rel=2e-3, abs=0.0)
    holed = z.copy()
    holed[34, 31] = np.nan
    assert "1 cells have no height" in reason(found(Subject(map_of(holed), mask, target), "volume"), "volume_error")
    assert "no droplet landed" in reason(found(Subject(map_of(z), mask, droplets=0), "volume"), "droplet_volume")


def of_all_points(terms: np.ndarray, values: np.ndarray) -> float:
    """Half width of the zone by one linear program over every point."""
    ones = np.ones((len(values), 1))
    solved = linprog(
        np.append(np.zeros(terms.shape[1]), 1.0),
        A_ub=np.block([[terms, -ones], [-terms, -ones]]),
        b_ub=np.concatenate([values, -values]),
        bounds=[(None, None)] * (terms.shape[1] + 1),
    )
    return float(solved.x[-1])


@pytest.mark.parametrize("kind", ["rough", "dome", "saddle", "waves", "few"])
def test_the_zone_is_that_of_the_linear_program(kind: str) -> None:
    rng = np.random.default_rng(7)
    x, y = rng.uniform(-1.0, 1.0, (2, 5 if kind == "few" else 1000))
    z = {
        "rough": rng.normal(size=x.size),
        "few": rng.normal(size=x.size),
        "dome": -x * x - y * y,
        "saddle": x * y,
        "waves": np.sin(9 * x) * np.cos(7 * y) + 0.4 * x**3,
    }[kind]
    terms = np.column_stack([np.ones_like(x), x, y])
    factors, half = minimax(terms, z + 3.0 * x - 50.0)
    assert half == pytest.approx(of_all_points(terms, z), rel=1e-6, abs=0.0)
    assert np.abs(z + 3.0 * x - 50.0 - terms @ factors).max() == pytest.approx(half, rel=1e-9, abs=0.0)


def test_a_parabola_has_its_chebyshev_line() -> None:
    """x^2 on [-1, 1]: the best constant and line is 1/2, the zone 1/2, in any unit and far from the origin."""
    x = np.linspace(-1.0, 1.0, 2001)
    terms = np.column_stack([np.ones_like(x), x * 1e-3])
    factors, half = minimax(terms, 1e-6 * x**2 + 1e-3)
    assert half == pytest.approx(0.5e-6, rel=1e-6, abs=0.0)
    assert factors == pytest.approx([1e-3 + 0.5e-6, 0.0], rel=1e-6, abs=1e-9)


def test_points_on_a_plane_have_no_zone() -> None:
    x, y = np.indices((5, 4)).reshape(2, -1) * 1e-5
    assert minimax(np.column_stack([np.ones_like(x), x, y]), 2.0 + 0.1 * x - 0.2 * y)[1] < 1e-14


@pytest.mark.parametrize("sizes", [(1e-4, 4e-4), (4e-4, 1e-4), (1e-4, 1e-4)])
def test_central_third_of_a_face_is_measured_in_metres(sizes: tuple[float, float]) -> None:
    nx, ny = 24, 9
    i, j = np.indices((nx, ny)) + 1
    distance = np.minimum(np.minimum(i, nx + 1 - i) * sizes[0], np.minimum(j, ny + 1 - j) * sizes[1])
    found = central_third(np.ones((nx, ny), np.bool_), sizes)
    np.testing.assert_array_equal(found, distance >= CENTRE * distance.max() * (1 - 1e-12))
