"""A print in two inks: a cut that shows the inks, and the solid without its support.

The solid is seen from above and the side: rays are marched through its voxels, shaded by the slope of its surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.report.plot import (
    ERROR_COLOURS,
    MATERIAL_COLOURS,
    Runs,
    add_scale,
    error_norm,
    middle_row,
    new_figure,
    round_below,
)
from inkloop.results.solid import STEP_M, ink_error, voxels
from inkloop.units import MM_PER_M, UM_PER_M

__all__ = ["solids"]

SOLID_UPRIGHT = 0.45  # height of a solid's picture as a share of its width: parts are far wider than high
SCALE_SHARE = 0.25  # length of a scale bar, at most, as a share of the part's size
SCALE_ROOM = 0.16  # share of the picture's width for the scale bars, left of the part
HEADROOM = 1.04
STEPS = 320  # along a ray: less than a cell of the usual grids each
PIXELS = 360  # along the diagonal of the box
FRAME = 3  # empty voxels around the solid
SMOOTHING_VOXELS = (1.0, 1.0, 3.0)  # a cell is far wider than a voxel is high
LIGHT = (-0.5, -0.4, 0.77)  # direction of the light, in the box of the solid
Image = NDArray[np.float32]
"""(rows, columns), NaN where nothing is seen; row 0 at the bottom."""


def materials(run: xr.Dataset, name: str) -> Figure:
    """Cut through the middle of a print in two inks: the ink at each height, and the wanted region of A."""
    row = middle_row(run)
    cut = voxels(run.isel(y=[row]))[:, 0]
    figure = new_figure(2.6)
    axes = figure.subplots()
    half = float(run.attrs["pitch"]) / 2 * MM_PER_M
    x = run.x.values * MM_PER_M
    top = cut.shape[1] * STEP_M * UM_PER_M
    extent = (x[0] - half, x[-1] + half, 0.0, top)
    axes.imshow(cut.T, origin="lower", extent=extent, interpolation="nearest", cmap=MATERIAL_COLOURS, vmin=0, vmax=2)
    handles: list[Artist] = [Patch(color=MATERIAL_COLOURS(n), label=f"ink {ink}") for n, ink in ((1, "A"), (2, "B"))]
    line: dict[str, Any] = {"color": "black", "linewidth": 0.9}
    for bottom, upper in zip(run.region_bottom[:, :, row].values, run.region_top[:, :, row].values, strict=True):
        within = run.mask[:, row].values.astype(bool) & ~np.isnan(bottom)
        for edge in (np.maximum(bottom, 0.0), np.minimum(upper, run.target_height[:, row].values)):
            axes.step(x, np.where(within, edge * UM_PER_M, np.nan), where="mid", **line)
    handles.append(Line2D([], [], label="bounds of ink A\nin the part", **line))
    axes.set_aspect("auto")
    axes.set(xlabel="x [mm]", ylabel="height [µm]", ylim=(0.0, HEADROOM * top))
    axes.set_title(f"{name}: cut at y = {float(run.y[row]) * MM_PER_M:.2f} mm")
    figure.legend(handles=handles, loc="outside right center", frameon=False)
    return figure


def solids(runs: Runs) -> Figure:
    """Prints in two inks without ink B, the support; coloured where ink A is missing or too much.

    Heights are stretched, as the scale bars of each picture show. No error below a layer has the darkest colour.
    """
    figure = new_figure(2.8)
    views = [view(voxels(run) == 1, SOLID_UPRIGHT) for run in runs.values()]
    errors = [_seen_error(run, seen) for run, seen in zip(runs.values(), views, strict=True)]
    layer = max(float(np.ptp(run.height[:2].values, axis=0).max()) for run in runs.values()) * UM_PER_M
    colours = ScalarMappable(error_norm(errors, layer), ERROR_COLOURS)
    inside = np.logical_or.reduce([~np.isnan(seen.brightness) for seen in views])
    frame = np.ix_(inside.any(1), inside.any(0))  # one for all, so that sizes can be compared
    columns = figure.subplots(1, len(runs), squeeze=False)[0]
    for axes, seen, error, (name, run) in zip(columns, views, errors, runs.items(), strict=True):
        light = seen.brightness[frame]
        surface = colours.to_rgba(np.nan_to_num(error[frame]))[..., :3] * np.nan_to_num(light)[..., None]
        image = np.concatenate([surface, ~np.isnan(light)[..., None]], axis=-1)
        axes.imshow(image, origin="lower")
        axes.set_title(f"{name}\nmismatch {float(run.mismatch):.1%}")
        axes.set_axis_off()
        top = voxels(run).shape[2] * STEP_M
        draw_scales(axes, seen, max(run.sizes["x"], run.sizes["y"]) * float(run.attrs["pitch"]), top / SOLID_UPRIGHT)
    add_scale(figure, colours, "error of ink A [µm]", ("missing", "too much"), ax=list(columns), shrink=0.7)
    return figure


def _seen_error(run: xr.Dataset, seen: View) -> FloatMap:
    """The error of ink A at each pixel [um], NaN where no solid is visible."""
    error = ink_error(run)[tuple(np.moveaxis(seen.voxel, -1, 0))] * UM_PER_M
    return np.asarray(np.where(np.isnan(seen.brightness), np.nan, error))


def draw_scales(axes: Axes, seen: View, width_m: float, stretched_m: float) -> None:
    """A bar along x, y and z in the lower left corner, each with its length.

    width_m: longer side of the solid; stretched_m: the height that would be drawn as long as that side.
    """
    flat = round_below(SCALE_SHARE * width_m * MM_PER_M) / MM_PER_M
    high = round_below(SCALE_SHARE * SOLID_UPRIGHT * stretched_m * UM_PER_M) / UM_PER_M
    ends = seen.axes * np.array([flat / width_m, flat / width_m, high / stretched_m])[:, None]
    left, right = axes.get_xlim()
    low, up = axes.get_ylim()
    room = SCALE_ROOM * (right - left)
    axes.set_xlim(left - room, right)
    axes.set_ylim(low - max(0.0, -float(ends[:, 1].min())), up)
    words = (f"{flat * MM_PER_M:g} mm", f"{flat * MM_PER_M:g} mm", f"{high * UM_PER_M:g} µm")
    for (x, y), word, side in zip(ends, words, ("left", "left", "right"), strict=True):
        axes.plot([left - room, left - room + x], [low, low + y], color="black", linewidth=1.0, clip_on=False)
        place: dict[str, Any] = {"ha": side, "va": "bottom", "fontsize": 6, "annotation_clip": False}
        axes.annotate(word, (left - room + x, low + y), (1, 1), textcoords="offset points", **place)


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
