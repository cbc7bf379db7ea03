"""Parts as analytic shapes."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop.geometry import Cuboid, Cylinder, PipeJunction, Staircase, cell_centers, contained

PITCH = 263.256e-6


def test_cylinder_stands_on_the_cells_whose_centres_it_covers() -> None:
    x, y = cell_centers(35, 35, PITCH)
    i, j = np.meshgrid(np.arange(35), np.arange(35), indexing="ij")
    footprint = Cylinder(17 * PITCH, 17 * PITCH, 15 * PITCH, 400e-6).contains(x, y, np.zeros_like(x))
    np.testing.assert_array_equal(footprint, (i - 17) ** 2 + (j - 17) ** 2 <= 225)
    assert footprint.sum() == 709


def test_cuboid_of_eight_pitches_stands_on_eight_cells_each_way_and_ends_at_its_top() -> None:
    x, y = cell_centers(12, 12, PITCH)
    cuboid = Cuboid(5.5 * PITCH, 5.5 * PITCH, 8 * PITCH, 8 * PITCH, 22.8e-6)
    footprint = cuboid.contains(x, y, np.zeros_like(x))
    assert footprint.sum() == footprint[2:10, 2:10].sum() == 64
    for z in (-1e-6, 23.8e-6):
        assert not cuboid.contains(x, y, np.full_like(x, z)).any()


def test_base_of_a_cuboid_and_of_stairs_has_its_own_edge_along_each_axis() -> None:
    x, y = cell_centers(12, 9, PITCH)
    at = (5.5 * PITCH, 4.0 * PITCH, 8 * PITCH, 3 * PITCH)
    for shape in (Cuboid(*at, 22.8e-6), Staircase(*at, 4, 22.8e-6)):
        footprint = shape.contains(x, y, np.zeros_like(x))
        assert footprint.sum() == footprint[2:10, 3:6].sum() == 8 * 3


def test_bores_of_a_pipe_junction_open_into_each_other() -> None:
    pipes = PipeJunction(0.0, 0.0, 20e-4, 180e-6, 13e-4, 117e-6, 400e-6)
    at = np.array([0.0, 30e-4, 16e-4, 16e-4, 30e-4])  # centre, along the bore, wall of the other pipe, corner outside
    across = np.array([0.0, 0.0, 16e-4, 0.0, 30e-4])
    inside = pipes.contains(at, across, np.full(5, 200e-6))
    np.testing.assert_array_equal(inside, [False, False, True, False, False])


def test_wall_of_a_pipe_lies_between_two_ellipses() -> None:
    pipes = PipeJunction(1e-4, 2e-4, 20e-4, 180e-6, 13e-4, 117e-6, 400e-6)
    x, y, z = np.random.default_rng(1).uniform(0, 30e-4, (3, 10000)) * np.array([[1.0], [1.0], [0.13]])
    ellipses = [
        ((across / half_across) ** 2 + ((z - 200e-6) / half_upright) ** 2 <= 1.0)
        for across in (x - 1e-4, y - 2e-4)
        for half_across, half_upright in ((20e-4, 180e-6), (13e-4, 117e-6))
    ]
    outer, inner = ellipses[0] | ellipses[2], ellipses[1] | ellipses[3]
    np.testing.assert_array_equal(pipes.contains(x, y, z), outer & ~inner)
    assert 1000 < (outer & ~inner).sum() < 9000


def test_side_of_a_pipe_is_part_of_it_at_half_the_height_alone() -> None:
    pipes = PipeJunction(0.0, 0.0, 3e-4, 10e-6, 2e-4, 6e-6, 20e-6)
    ((bottom, top), nothing) = pipes.intervals(np.full(1, 4e-4), np.full(1, 3e-4))
    assert 10e-6 - 1e-9 < bottom[0] < 10e-6 < top[0] < 10e-6 + 1e-9
    assert not contained([nothing], np.linspace(-1.0, 1.0, 99)).any()


def test_steps_of_a_staircase_are_equally_wide_and_high() -> None:
    x, y = cell_centers(12, 5, PITCH)
    stairs = Staircase(5.5 * PITCH, 2.0 * PITCH, 8 * PITCH, 3 * PITCH, 4, 200e-6)
    top = np.where(stairs.contains(x, y, np.zeros_like(x)), stairs.top(x, y), 0.0)
    np.testing.assert_allclose(top[:, 2] * 1e6, [0, 0, 50, 50, 100, 100, 150, 150, 200, 200, 0, 0])
    assert not stairs.contains(x, y, stairs.top(x, y) + 1e-6).any()
    for edge in (-2.0, 0.0, 2.0):  # an edge belongs to the lower step
        at = edge * PITCH + 5.5 * PITCH
        below, above = stairs.top(np.array([at, at + 1e-6]), np.zeros(2))
        assert above - below == pytest.approx(50e-6, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("center", [k / 2 for k in range(9, 60)])
def test_step_of_an_edge_and_of_both_ends_holds_wherever_the_stairs_stand(center: float) -> None:
    """Eight cells in four steps, the edges between cells as numbers round them."""
    stairs = Staircase(center * PITCH, 0.0, 8 * PITCH, 3 * PITCH, 4, 200e-6)
    edges = (center + np.array([-4.0, -2.0, 0.0, 2.0, 4.0])) * PITCH
    np.testing.assert_allclose(stairs.top(edges, np.zeros(5)) * 1e6, [50, 50, 100, 150, 200], rtol=1e-12)


def test_wall_of_a_bore_is_not_part_of_the_pipe() -> None:
    pipes = PipeJunction(0.0, 0.0, 20e-4, 180e-6, 13e-4, 117e-6, 400e-6)
    ends = 200e-6 + np.array([-1.0, 1.0]) * 117e-6 * np.sqrt(1.0 + 1e-9)
    at = np.zeros(2)
    assert not pipes.contains(at, at, ends).any()
    assert pipes.contains(at, at, np.nextafter(ends, [0.0, 1.0])).all()
