"""Invariants of liquid bodies at rest on a solid (Hume, Rosen 2018), shown on the kernels."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import brentq

from support.fmus.young_laplace_library import (
    ANGLE,
    LINEAR,
    NONLINEAR,
    PITCH,
    VOLUME,
    Liquid,
    Place,
    Print,
    library,
    numbers,
)
from support.long_proofs import rest_is_long
from support.numpy import young_laplace_numpy

pytestmark = pytest.mark.compiled

FORMS = pytest.mark.parametrize("form", [LINEAR, NONLINEAR])


def only(nx: int, ny: int, *sites: tuple[int, int]):
    drops = np.zeros((nx, ny))
    for site in sites:
        drops[site] = 1.0
    return drops


@pytest.mark.parametrize(("size", "bandwidth"), [(1, 1), (2, 1), (2, 5), (7, 1), (8, 3), (40, 6), (41, 6), (300, 27)])
def test_banded_cholesky_agrees_with_scipy(size, bandwidth) -> None:
    generator = np.random.default_rng(size + bandwidth)
    band = generator.uniform(-1.0, 1.0, (bandwidth + 1, size))
    band[0] = 2.0 * bandwidth + 1.0
    for k in range(1, bandwidth + 1):
        band[k, max(0, size - k) :] = 0.0
    one, other = generator.normal(size=(2, size))
    factor = cholesky_banded(band, lower=True)
    expected = [cho_solve_banded((factor, True), values) for values in (one, other)]
    ours = np.ascontiguousarray(band.T)
    assert library().band_factor(numbers(ours), ctypes.c_size_t(size), ctypes.c_size_t(bandwidth))
    library().band_solve(numbers(ours), ctypes.c_size_t(size), ctypes.c_size_t(bandwidth), numbers(one), numbers(other))
    assert pytest.approx(factor, rel=1e-13, abs=1e-14) == ours.T
    assert np.array([one, other]) == pytest.approx(np.array(expected), rel=1e-11, abs=1e-13)


def test_matrix_that_is_not_positive_definite_has_no_factor() -> None:
    band = np.array([[1.0, 2.0], [1.0, 0.0]])
    assert not library().band_factor(numbers(band), ctypes.c_size_t(2), ctypes.c_size_t(1))


def test_convex_hull_agrees_with_scipy() -> None:
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(1).normal(size=(500, 2))
    places, hull = (Place * 500)(*(Place(*p) for p in points)), (Place * 501)()
    count = library().convex_hull(places, ctypes.c_size_t(500), hull)
    found = np.array([(p.x, p.y) for p in hull[:count]])
    expected = points[ConvexHull(points).vertices]
    assert sorted(map(tuple, found)) == sorted(map(tuple, expected))
    area = 0.5 * np.sum(found[:, 0] * np.roll(found[:, 1], -1) - np.roll(found[:, 0], -1) * found[:, 1])
    assert area == pytest.approx(ConvexHull(points).volume, rel=1e-12, abs=0.0)


def test_convex_hull_of_rows_and_columns_has_its_corners_only() -> None:
    """Counter-clockwise from the lowest of the leftmost points on."""
    points = np.random.default_rng(2).permutation([(x, y) for x in range(5) for y in range(4)])
    places, hull = (Place * 20)(*(Place(*p) for p in points)), (Place * 21)()
    count = library().convex_hull(places, ctypes.c_size_t(20), hull)
    assert [(p.x, p.y) for p in hull[:count]] == [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]


def test_level_ground_gives_the_base_radius_of_the_cap() -> None:
    """30 pL at 45 degrees: 35.1999 um (Hume, Rosen 2018: 35.2 um)."""
    radius = library().cap_radius(ctypes.c_double(VOLUME), ctypes.c_double(ANGLE))
    assert radius * 1e6 == pytest.approx(35.1999, abs=5e-5)
    assert radius == pytest.approx(young_laplace_numpy.cap_radius(VOLUME, ANGLE), rel=1e-12, abs=0.0)


CENTRE = {NONLINEAR: 14.5803, LINEAR: 15.4141}
"""Height of a 30 pL cap of 45 degrees, and of the paraboloid on the same base [um]."""


def centre_error(per_pitch: int, form: int) -> float:
    """An odd number of points has one under the droplet's site [um]."""
    cap = Print(3, 3, per_pitch, form)
    cap.layer(only(3, 3, (1, 1)))
    return float(abs(cap.height.max() * 1e6 - CENTRE[form]))


@FORMS
@pytest.mark.parametrize("per_pitch", [5, 9, 17, 33, 65])
def test_single_droplet_converges_to_the_exact_cap_with_the_square_of_the_spacing(form, per_pitch) -> None:
    assert centre_error(per_pitch, form) <= 0.0045 * (42.3 / per_pitch) ** 2


@FORMS
def test_long_line_has_the_profile_of_a_cylinder(form) -> None:
    """Far from its ends a line solves the equation in one dimension: a circle, or a parabola."""
    line = Print(15, 5, 16, form)
    line.layer(only(15, 5, *((i, 2) for i in range(15))))
    across = line.height[len(line.height) // 2 - 8 : len(line.height) // 2 + 8].mean(axis=0)
    y = (np.arange(len(across)) - 0.5 * (len(across) - 1)) * line.spacing
    half, area = 35.1999e-6, across.sum() * line.spacing
    if form == LINEAR:
        exact = 0.75 * area / half * (1.0 - (y / half) ** 2)
    else:
        angle = brentq(lambda t: half**2 * (t - np.sin(t) * np.cos(t)) / np.sin(t) ** 2 - area, 0.01, 1.5)
        radius = half / np.sin(angle)
        exact = np.sqrt(np.maximum(radius**2 - y**2, 0.0)) - radius * np.cos(angle)
    inside = np.abs(y) < half
    assert np.abs(across - exact)[inside].max() <= 0.1e-6
    assert across[~inside] == pytest.approx(0.0, abs=1e-12)


def step_of_a_layer(columns: int, rim: int, per_pitch: int):
    """15 um high, up to the middle of the second site, over one and a half points."""
    x = (np.arange(columns) - rim + 0.5) / per_pitch
    return 15e-6 * np.clip((1.5 - x) * per_pitch / 1.5 + 0.5, 0.0, 1.0)


@FORMS
def test_droplets_on_a_step_agree_with_the_twin(form) -> None:
    """A line of five droplets across the edge of a layer, the paper's example."""
    ours = Print(5, 3, 6, form)
    ours.height += step_of_a_layer(len(ours.height), ours.rim, 6)[:, None]
    start, drops = ours.height.copy(), only(5, 3, *((i, 1) for i in range(5)))
    ours.layer(drops, [(0, 1)])
    twin = young_laplace_numpy.print_pass(start, drops, range(3), 6, VOLUME, ANGLE, ours.spacing, form == NONLINEAR)
    assert ours.fallbacks == 0
    assert np.abs(ours.height - twin).max() <= (1e-14 if form == LINEAR else 2e-9)


@FORMS
def test_layers_on_top_of_each_other_agree_with_the_twin(form) -> None:
    """Bodies of one to four droplets, two layers deep, resting on the solid in places."""
    generator = np.random.default_rng(5)
    ours = Print(4, 4, 5, form)
    twin = ours.height.copy()
    for _ in range(2):
        drops = generator.choice([0.0, 1.0, 1.0, 1.3], (4, 4))
        ours.layer(drops, [(0, 2), (1, 2)])
        for first in (0, 1):
            twin = young_laplace_numpy.print_pass(
                twin, drops, range(first, 4, 2), 5, VOLUME, ANGLE, ours.spacing, form == NONLINEAR
            )
    assert ours.fallbacks == 0
    assert np.abs(ours.height - twin).max() <= (1e-14 if form == LINEAR else 2e-8)


@FORMS
def test_liquid_never_cuts_into_the_solid_and_volume_is_conserved(form) -> None:
    generator = np.random.default_rng(2)
    ours, printed = Print(9, 9, 6, form), 0.0
    for _ in range(6):
        before, drops = ours.height.copy(), generator.integers(0, 3, (9, 9)) * generator.uniform(0.6, 1.0, (9, 9))
        ours.layer(drops)
        printed += drops.sum() * VOLUME
        assert (ours.height - before).min() >= -1e-15
        assert ours.volume == pytest.approx(printed, rel=1e-12, abs=0.0)
        assert ours.cells.sum() * PITCH**2 + ours.lost == pytest.approx(printed, rel=1e-12, abs=0.0)


def test_bodies_of_a_pass_know_nothing_of_each_other() -> None:
    drops = np.random.default_rng(3).integers(0, 2, (9, 8))
    together, apart = Print(9, 8, 6), Print(9, 8, 6)
    for _ in range(3):
        together.layer(drops, [(0, 4), (1, 4), (2, 4), (3, 4)])
        apart.layer(drops, [(4, 8), (0, 8), (1, 8), (5, 8), (6, 8), (2, 8), (3, 8), (7, 8)])
    assert np.array_equal(together.height, apart.height)


def test_droplet_reaches_less_far_where_its_path_climbs() -> None:
    """On a plane that rises with 45 degrees along x the footprint is narrower there by the square root of 2."""
    ours = Print(5, 5, 8)
    ours.height += np.arange(len(ours.height))[:, None] * ours.spacing
    before = ours.height.copy()
    ours.layer(only(5, 5, (2, 2)))
    wet = ours.height > before
    along_x, along_y = wet.any(axis=1).sum(), wet.any(axis=0).sum()
    assert along_y == pytest.approx(2 * 35.2 / 42.3 * 8, abs=1.0)
    assert along_x == pytest.approx(along_y / np.sqrt(2.0), abs=1.0)


def test_body_that_would_have_to_overhang_is_solved_linearly_and_counted() -> None:
    """Next to a wall ten times as high as a droplet, no surface of constant mean curvature is a function of place."""
    square = np.zeros((10, 10))
    square[2:-2, 2:-2] = 1.0
    tall, linear = Print(10, 10, 6), Print(10, 10, 6, LINEAR)
    for _ in range(8):
        tall.layer(square)
        linear.layer(square)
    assert 0 < tall.fallbacks < 8 * 6 / 2
    assert linear.fallbacks == 0
    assert tall.volume == pytest.approx(8 * 36 * VOLUME, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("per_pitch", rest_is_long([8, 16, 24, 32], 3))
def test_steep_bodies_of_a_second_layer_have_a_solution_on_any_grid(per_pitch) -> None:
    square = np.zeros((9, 9))
    square[2:-2, 2:-2] = 1.0
    print_ = Print(9, 9, per_pitch)
    for _ in range(2):
        print_.layer(square)
    assert print_.fallbacks == 0
    assert print_.cells.max() == pytest.approx(44.09e-6, rel=1e-3, abs=0.0)


@pytest.mark.parametrize("per_pitch", [8, 16, 32])
def test_cap_is_a_solution_however_steep(per_pitch) -> None:
    """A spherical cap of 1.4 rad: its edge is as steep as 80 degrees all around."""
    print_ = Print(5, 5, per_pitch)
    print_.liquid = Liquid(VOLUME, 1.4, NONLINEAR)
    print_.layer(only(5, 5, (2, 2)))
    assert print_.fallbacks == 0


@pytest.mark.parametrize("per_pitch", rest_is_long([8, 16, 32], 2))
@pytest.mark.parametrize(("cylinders", "fallbacks"), [(0.7, 0), (0.75, 0), (1.2, 1), (1.5, 1)])
def test_line_with_more_liquid_than_a_half_cylinder_has_no_solution(cylinders, fallbacks, per_pitch) -> None:
    """Beyond it a circle through both edges is wider than they are apart. cylinders: cross-section, in half circles."""
    radius = library().cap_radius(ctypes.c_double(VOLUME), ctypes.c_double(1.4))
    line = Print(22, 5, per_pitch, pitch=VOLUME / (cylinders * np.pi * radius**2 / 2.0))
    line.liquid = Liquid(VOLUME, 1.4, NONLINEAR)
    line.layer(only(22, 5, *((i, 2) for i in range(3, 19))))
    assert line.fallbacks == fallbacks


@pytest.mark.parametrize(("nx", "ny"), [(6, 4), (4, 6)])
def test_cells_become_a_continuous_surface_with_their_means(nx, ny) -> None:
    """Between the centres of cells of a plane it is that plane, except in cells at the border."""
    cells = np.random.default_rng(4).uniform(0.0, 5e-6, (nx, ny))
    for per_pitch in (2, 5, 8):
        ours, flat = Print(nx, ny, per_pitch), Print(nx, ny, per_pitch)
        i, j = np.indices((nx, ny))
        library().spread_cells(ctypes.byref(flat.surface), numbers(1e-5 + 2e-6 * i - 1e-6 * j))
        x, y = ((np.arange(count) - flat.rim + 0.5) / per_pitch - 0.5 for count in flat.height.shape)
        inner = np.ix_(abs(x - 0.5 * (nx - 1)) < 0.5 * nx - 1.0, abs(y - 0.5 * (ny - 1)) < 0.5 * ny - 1.0)
        plane = 1e-5 + 2e-6 * x[:, None] - 1e-6 * y
        assert flat.height[inner] == pytest.approx(plane[inner], rel=1e-9, abs=0.0)
        library().spread_cells(ctypes.byref(ours.surface), numbers(cells))
        assert ours.cells == pytest.approx(cells, rel=1e-12, abs=0.0)
        assert np.abs(np.diff(ours.height, axis=0)).max() <= 5.0 * 5e-6 / per_pitch * 4.0
