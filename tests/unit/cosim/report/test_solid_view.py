"""The picture of a solid shows the first point of each ray that is inside, however few points are looked at."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from inkloop.report import solid_picture as solid_view
from inkloop.report.solid_picture import FRAME, LIGHT, SMOOTHING_VOXELS, view

PIXELS, STEPS = 40, 60
RANDOM = gaussian_filter(np.random.default_rng(0).random((9, 7, 24)), (1.0, 1.0, 3.0)) > 0.5
SOLIDS = {"block": np.ones((12, 8, 24), np.bool_), "random": RANDOM, "nothing": np.zeros((6, 6, 8), np.bool_)}


@pytest.mark.parametrize(("azimuth", "elevation"), [(-60.0, 32.0), (120.0, 5.0), (0.0, 90.0), (90.0, 0.0)])
@pytest.mark.parametrize("name", SOLIDS)
def test_every_pixel_is_that_of_a_ray_marched_through_the_whole_box(
    name: str, azimuth: float, elevation: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(solid_view, "PIXELS", PIXELS)
    monkeypatch.setattr(solid_view, "STEPS", STEPS)
    solid = SOLIDS[name]
    seen = view(solid, 0.4, azimuth_deg=azimuth, elevation_deg=elevation)
    density = gaussian_filter(np.pad(solid, FRAME).astype(np.float32), SMOOTHING_VOXELS)
    size = np.array([*(np.array(solid.shape[:2]) / max(solid.shape[:2])), 0.4])
    a, e, half = np.radians(azimuth), np.radians(elevation), 0.5 * np.linalg.norm(size)
    camera = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    side, depth = np.linspace(-half, half, PIXELS), np.linspace(half, -half, STEPS)
    rows, columns, depths = np.meshgrid(side, side, depth, indexing="ij")
    points = size / 2 + columns[..., None] * right + rows[..., None] * np.cross(camera, right)
    points = (points + depths[..., None] * camera) * ((np.array(density.shape) - 1) / size)
    inside = map_coordinates(density, np.moveaxis(points, -1, 0), order=1, cval=0.0) > 0.5
    first = inside.argmax(axis=-1)
    found = np.take_along_axis(points, first[..., None, None], axis=2)[:, :, 0].round() - FRAME
    expected = np.where(inside.any(axis=-1)[..., None], found, 0).clip(0, np.array(solid.shape) - 1)
    np.testing.assert_array_equal(np.isfinite(seen.brightness), inside.any(axis=-1))
    np.testing.assert_array_equal(seen.voxel, expected)


@pytest.mark.parametrize("rise", [1, 2])
def test_brightness_of_a_slope_is_that_of_its_angle_in_the_part_not_in_voxels(rise: int) -> None:
    """Of a plane that rises by so many voxels with each cell, seen from above."""
    cells, upright = 32, 0.4
    i, _, k = np.indices((cells, cells, (rise + 1) * cells))
    solid = k < cells // 2 + rise * i
    x, _, z = (np.array(solid.shape) + 2 * FRAME - 1) / (1.0, 1.0, upright)
    normal = np.array([-rise * x / z, 0.0, 1.0])
    light = np.array(LIGHT)
    expected = 0.3 + 0.7 * normal @ light / np.linalg.norm(normal) / np.linalg.norm(light)
    middle = slice(solid_view.PIXELS * 2 // 5, solid_view.PIXELS * 3 // 5)
    seen = view(solid, upright, azimuth_deg=0.0, elevation_deg=90.0).brightness[middle, middle]
    assert seen.mean() == pytest.approx(expected, rel=0.01, abs=0.0)
