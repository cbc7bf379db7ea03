"""The square of Hume and Rosen (2018) by remeshing finite elements, as in the paper, compared with inkloop's kernel."""

from __future__ import annotations

from time import process_time
from typing import Any

import numpy as np
from rich.table import Table
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import map_coordinates
from scipy.spatial import ConvexHull

from inkloop.units import MS_PER_S, UM_PER_M
from inkloop_lab.reproduce import finite_elements, square

PITCH_UM, RADIUS_UM, VOLUME_UM3, ELEMENT_UM, PER_PITCH = 42.3, 35.1999, 30e3, 5.0, 8
RAYS, STEP = 64, 0.25
LAYERS = 2
PAPER_LAYER_S = 90.0
Map = Any


def measure() -> Table:
    """Processor time for a layer of 25 lines, and how far the two surfaces are apart."""
    table = Table(title=f"square, 25 x 25 droplets: processor time per layer, mean of {LAYERS} layers")
    headings = ("form", "paper", "scikit-fem, 5 um", "ours, dx 5.3 um")
    for heading in (*headings, "faster than scikit-fem", "faster than the paper", "rms between the two"):
        table.add_column(heading, justify="left" if heading == "form" else "right")
    for form in ("linear", "nonlinear"):
        by_elements, elements_s = _by_elements(form)
        surface, ours_s = square.printed(form, PER_PITCH, LAYERS)
        apart = float(np.sqrt(np.mean((surface.over_grid * UM_PER_M - by_elements) ** 2)))
        times = f"{PAPER_LAYER_S:g} s", f"{elements_s / LAYERS:.2f} s", f"{ours_s / LAYERS * MS_PER_S:.0f} ms"
        ratios = f"{elements_s / ours_s:.0f} x", f"{PAPER_LAYER_S * LAYERS / ours_s:.0f} x"
        table.add_row(form, *times, *ratios, f"{apart:.2f} um")
    return table


def _by_elements(form: str) -> tuple[Map, float]:
    """The surface [um] at our kernel's points, and the processor time [s]; h >= substrate by cutting off; no source
    states another way.
    """
    cells = square.SIDE + 2 * square.MARGIN
    surface = np.zeros((cells * PER_PITCH, cells * PER_PITCH))
    begin = process_time()
    for _ in range(LAYERS):
        for colour in range(4):
            before = surface.copy()
            for line in range(square.MARGIN, square.MARGIN + square.SIDE):
                if line % 4 == colour:
                    _print_line(before, surface, line, form)
    return surface, process_time() - begin


def _print_line(before: Map, surface: Map, line: int, form: Any) -> None:
    """One body: rays, hull, mesh, solution, back onto the grid."""
    spacing = PITCH_UM / PER_PITCH
    sites = [(i, line) for i in range(square.MARGIN, square.MARGIN + square.SIDE)]
    ends = np.concatenate([_ends(before, (np.array(site) + 0.5) * PITCH_UM, spacing) for site in sites])
    outline = ends[ConvexHull(ends).vertices]

    def ground(places: Map) -> Map:
        return map_coordinates(before, places.T / spacing - 0.5, order=1, mode="nearest")

    volume = VOLUME_UM3 * len(sites)
    try:
        found = finite_elements.solve(outline, volume, ELEMENT_UM, form=form, ground=ground)
    except RuntimeError:
        found = finite_elements.solve(outline, volume, ELEMENT_UM, form="linear", ground=ground)
    low = np.floor(outline.min(axis=0) / spacing).astype(int)
    high = np.ceil(outline.max(axis=0) / spacing).astype(int)
    grid = np.stack(np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True)), indexing="ij"), -1)
    index = grid.reshape(-1, 2)
    places = (index + 0.5) * spacing
    planes = ConvexHull(outline).equations
    inside = (places @ planes[:, :2].T + planes[:, 2] < -1e-6).all(axis=1)
    height = LinearNDInterpolator(found.places, found.height)(places[inside])
    height = np.where(np.isnan(height), before[tuple(index[inside].T)], height)
    i, j = index[inside].T
    surface[i, j] = np.maximum(height, before[i, j])


def _ends(surface: Map, site: Map, spacing: float) -> Map:
    """Where the path over the surface from a site is as long as the radius, (64, 2) [um]."""
    turns = np.arange(RAYS) * 2 * np.pi / RAYS
    length = RADIUS_UM * np.sqrt((2 * np.pi / RAYS) / np.sin(2 * np.pi / RAYS))
    way = np.arange(0.0, length + 2 * STEP * spacing, STEP * spacing)
    along = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    places = site + along[:, None, :] * way[None, :, None]
    heights = map_coordinates(surface, places.reshape(-1, 2).T / spacing - 0.5, order=1).reshape(RAYS, -1)
    steps = np.hypot(STEP * spacing, np.diff(heights))
    path = np.concatenate([np.zeros((RAYS, 1)), np.cumsum(steps, axis=1)], axis=1)
    reached = np.array([np.interp(length, path[ray], way) for ray in range(RAYS)])
    return np.asarray(site + along * reached[:, None])
