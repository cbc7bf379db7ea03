"""Picture of height-maps-from-files.md."""

from __future__ import annotations

import math

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter, map_coordinates
from tools.figures.pages import DOCS, Texts

from inkloop.component import BoolMap, FloatMap
from inkloop.metrology.cell_means import CellMeans, cell_means
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_fit import fit_to_surface
from inkloop.metrology.registration import Registration
from inkloop.report.plot import STYLE, WIDTH_IN, save
from inkloop.units import MM_PER_M, UM_PER_M

HERE = DOCS / "how-to"
PITCH, SIDE, LAYER = 263.256e-6, 16, 8e-6
PIXEL = 12e-6
SHAPE = (420, 400)
TRUTH = Registration(-0.55e-3, -0.25e-3, math.radians(5.0))
GUESS = Registration(-0.75e-3, -0.10e-3, math.radians(4.0))
SHARE_MIN = 0.5


def part() -> BoolMap:
    """An L of droplets with a margin of three cells."""
    mask = np.zeros((SIDE, SIDE), np.bool_)
    mask[3:13, 3:13] = True
    mask[8:13, 8:13] = False
    return mask


def scan(mask: BoolMap) -> HeightMap:
    """The part three layers high, uneven, with soft droplets, as a profiler sees it that was not set up straight."""
    rng = np.random.default_rng(4)
    cells = np.where(mask, 3 * LAYER + 1.2e-6 * rng.standard_normal(mask.shape), 0.0)
    soft = gaussian_filter(np.kron(cells, np.ones((8, 8))), 2.0)
    x, y = np.indices(SHAPE) * PIXEL
    on_grid = TRUTH.to_grid(x, y)
    z = map_coordinates(soft, [(position / PITCH + 0.5) * 8 - 0.5 for position in on_grid], order=1, mode="constant")
    z += 0.4e-6 * rng.standard_normal(SHAPE)
    slope = np.hypot(*np.gradient(z, PIXEL))
    z[(slope > 0.12) & (rng.random(SHAPE) < 0.6)] = np.nan  # steep flanks send little light back
    z[np.hypot(x - 2.1e-3, y - 2.9e-3) < 0.34e-3] = np.nan
    z[np.hypot(x - 3.3e-3, y - 1.6e-3) < 0.12e-3] = np.nan
    return HeightMap(z, PIXEL, PIXEL)


def height_maps() -> Figure:
    """The fine map with the grid found on it, the means of the cells, and how much of each was measured."""
    mask = part()
    map_ = scan(mask)
    fit = fit_to_surface(map_, mask.astype(np.float64), PITCH, GUESS, reach=3 * PITCH, rotation_reach=math.radians(2))
    cells = cell_means(map_, fit.registration, SIDE, SIDE, PITCH)
    figure = Figure(figsize=(WIDTH_IN, 2.75), layout="constrained")
    fine, means, shares = figure.subplots(1, 3, width_ratios=[1.0, 1.0, 1.0])
    limits = {"vmin": -1.0, "vmax": 3 * LAYER * UM_PER_M + 3.0, "cmap": "viridis"}
    extent = (0.0, SHAPE[0] * PIXEL * MM_PER_M, 0.0, SHAPE[1] * PIXEL * MM_PER_M)
    fine.imshow(map_.z.T * UM_PER_M, origin="lower", extent=extent, interpolation="nearest", **limits)
    draw_grid(fine, fit.registration)
    fine.set(title="as measured, and the grid found on it", xlabel="x of the profiler [mm]", ylabel="y [mm]")
    fine.set(xlim=extent[:2], ylim=extent[2:])
    valid = cells.valid(SHARE_MIN)
    top = means.imshow(
        np.where(valid, cells.mean, np.nan).T * UM_PER_M, origin="lower", interpolation="nearest", **limits
    )
    means.set(title="mean of each valid cell", xlabel="cell i")
    figure.colorbar(top, ax=means, label="height [µm]", location="bottom", shrink=0.9, pad=0.02)
    draw_shares(figure, shares, cells, valid)
    figure.colorbar(top, ax=fine, label="height [µm]", location="bottom", shrink=0.9, pad=0.02)
    for axes in (means, shares):
        axes.set_xticks(range(0, SIDE, 5))
        axes.set_yticks(range(0, SIDE, 5))
    means.set_ylabel("cell j")
    return figure


def draw_grid(axes: Axes, registration: Registration) -> None:
    """The borders of the cells where they lie on the map."""
    borders = (np.arange(SIDE + 1) - 0.5) * PITCH
    ends = np.full(SIDE + 1, borders[0]), np.full(SIDE + 1, borders[-1])
    lines: list[FloatMap] = []
    for first, last in (((borders, ends[0]), (borders, ends[1])), ((ends[0], borders), (ends[1], borders))):
        points = [np.stack(registration.to_map(*point), axis=-1) for point in (first, last)]
        lines.extend(np.stack(points, axis=1) * MM_PER_M + PIXEL * 0.5 * MM_PER_M)
    axes.add_collection(LineCollection(lines, colors="white", linewidths=0.35))


def draw_shares(figure: Figure, axes: Axes, cells: CellMeans, valid: FloatMap | BoolMap) -> None:
    """The measured share of each cell; a cross where it is too little."""
    shown = axes.imshow(cells.share.T * 100, origin="lower", interpolation="nearest", cmap="gray", vmin=0, vmax=100)
    i, j = np.nonzero(np.logical_not(valid))
    axes.plot(i, j, "x", color="tab:red", ms=5, mew=1.2)
    axes.set(title=f"measured share, x: below {SHARE_MIN:.0%}", xlabel="cell i")
    figure.colorbar(shown, ax=axes, label="share [%]", location="bottom", shrink=0.9, pad=0.02)


def run() -> None:
    """Draw the picture."""
    with rc_context(STYLE):
        save(height_maps(), HERE / "height-maps.png")


def texts() -> Texts:
    """None: the page shows a picture alone."""
    return {}
