"""A picture of a solid from above and the side: rays marched through its voxels, shaded by the slope of its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
"""(rows, columns), NaN where nothing is seen; row 0 at the bottom."""

STEPS = 320  # along a ray: less than a cell of the usual grids each
PIXELS = 360  # along the diagonal of the box
FRAME = 3  # empty voxels around the solid
SMOOTHING_VOXELS = (1.0, 1.0, 3.0)  # a cell is far wider than a voxel is high
LIGHT = (-0.5, -0.4, 0.77)  # direction of the light, in the box of the solid


@dataclass(frozen=True, eq=False)
class View:
    """View of a solid.

    brightness: 0 to 1; voxel: (rows, columns, 3) index of the voxel at each pixel, 0 where none is visible; axes: (3,
    2) pixels to the right and upwards of a step of one along each side of the box, whose longer side is 1.
    """

    brightness: Image
    voxel: NDArray[np.int64]
    axes: NDArray[np.float64]


def view(solid: NDArray[np.bool_], upright: float, *, azimuth_deg: float = -60.0, elevation_deg: float = 32.0) -> View:
    """The solid (nx, ny, nz) as seen along a direction, in parallel rays.

    upright: height of the box as a share of its longer side; azimuth and elevation as in Matplotlib.
    """
    from scipy.ndimage import gaussian_filter, map_coordinates  # a quarter of a second that other reports need not wait

    density = gaussian_filter(np.pad(solid, FRAME).astype(np.float32), SMOOTHING_VOXELS)
    size = np.array([*(np.array(solid.shape[:2]) / max(solid.shape[:2])), upright])
    scale = (np.array(density.shape) - 1) / size
    to_camera, right, up = _axes(np.radians(azimuth_deg), np.radians(elevation_deg))
    half = 0.5 * float(np.linalg.norm(size))
    rows, columns = np.meshgrid(*2 * [np.linspace(-half, half, PIXELS)], indexing="ij")
    on_screen = size / 2 + columns[..., None] * right + rows[..., None] * up
    image = np.full(rows.shape, np.nan, np.float32)
    voxel = np.zeros((*rows.shape, 3), np.int64)
    may_hit = _cells_with_a_dense_corner(density)
    dense = np.argwhere(may_hit) if may_hit.any() else np.zeros((1, 3))
    starts = on_screen.reshape(-1, 3)
    near, far = _depths_in_box(starts, to_camera, dense.min(axis=0) / scale, (dense.max(axis=0) + 1) / scale)
    for depth in np.linspace(half, -half, STEPS):
        rays = np.flatnonzero((depth <= near) & (depth >= far))
        points = (starts[rays] + depth * to_camera) * scale
        within = may_hit[tuple(points.astype(np.int64).clip(0, np.array(may_hit.shape) - 1).T)]
        rays, points = rays[within], points[within]
        hit = map_coordinates(density, points.T, order=1, cval=0.0) > 0.5
        image.ravel()[rays[hit]] = _brightness(density, points[hit], scale)
        voxel.reshape(-1, 3)[rays[hit]] = points[hit].round() - FRAME
        near[rays[hit]] = -np.inf  # visible voxels hide the rest of their rays
    axes = np.stack([right, up], axis=1) * (PIXELS - 1) / (2.0 * half)
    inner = (np.array(solid.shape) - 1) / (np.array(density.shape) - 1)  # the frame takes its share of the box
    return View(image, voxel.clip(0, np.array(solid.shape) - 1), axes * inner[:, None])


def _cells_with_a_dense_corner(density: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Cells between eight voxels in which an interpolated density can exceed one half, by their lowest voxel."""
    found = density > 0.5
    for axis in range(3):
        low, high = (found.take(range(start, found.shape[axis] - 1 + start), axis) for start in (0, 1))
        found = low | high
    return found


def _depths_in_box(
    starts: NDArray[np.float64], along: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Largest and least depth of each ray (rays, 3) in a box, widened against rounding; the least is larger outside."""
    along = np.where(np.abs(along) < 1e-12, 1e-12, along)  # a ray along a side of the box
    ends = np.stack([(low - 1e-9 - starts) / along, (high + 1e-9 - starts) / along])
    return ends.max(axis=0).min(axis=-1), ends.min(axis=0).max(axis=-1)


def _axes(azimuth: float, elevation: float) -> tuple[NDArray[np.float64], ...]:
    """Unit vectors to the camera, to the right of the picture, and up."""
    to_camera = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return to_camera, right, np.cross(to_camera, right)


def _brightness(density: NDArray[np.float32], points: NDArray[np.float64], scale: NDArray[np.float64]) -> Image:
    """Lambert's law at points of the surface."""
    from scipy.ndimage import map_coordinates

    slope = np.empty(points.shape)
    for axis in range(3):
        ahead = np.zeros(3)
        ahead[axis] = 1.0
        sides = [map_coordinates(density, (points + sign * ahead).T, order=1) for sign in (1, -1)]
        slope[:, axis] = (sides[1] - sides[0]) * scale[axis]
    slope /= np.linalg.norm(slope, axis=1, keepdims=True) + 1e-12
    lit = slope @ (np.array(LIGHT) / np.linalg.norm(LIGHT))
    return np.asarray(0.3 + 0.7 * np.clip(lit, 0.0, 1.0), np.float32)
