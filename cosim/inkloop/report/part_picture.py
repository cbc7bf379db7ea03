"""A picture of a part before it is printed: from above with narrow walls and gaps, as a solid, and as a cut."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from inkloop.component import BoolMap, Geometry, Job
from inkloop.geometry import Columns, cell_centers
from inkloop.report import plot
from inkloop.report.part_report import PartReport
from inkloop.report.solid_picture import SOLID_UPRIGHT, draw_scales, view
from inkloop.units import MM_PER_M, UM_PER_M

_LEVELS = 160  # of the solid and of the cut, from the substrate to the top
_NARROW = "#c8541b"
_INKS: dict[str, Any] = {"cmap": plot.MATERIAL_COLOURS, "vmin": 0.0, "vmax": 2.0, "interpolation": "nearest"}


def draw(report: PartReport, title: str, path: Path, formats: Sequence[str]) -> list[Path]:
    """Write `path` with the suffix of each format; the files."""
    with rc_context(plot.STYLE):
        figure = Figure(figsize=(plot.WIDTH_IN, 2.6), layout="constrained")
        above, solid, cut = figure.subplots(1, 3)
        job = report.scenario.job()
        _above(above, report, job)
        _solid(solid, report.part)
        _cut(cut, report.part, job)
        figure.suptitle(title, fontsize=9)
        return plot.save(figure, path, formats)


def _above(axes: Axes, report: PartReport, job: Job) -> None:
    """Heights of the target, with the cells of narrow walls and gaps."""
    half = 0.5 * job.pitch * MM_PER_M
    extent = (-half, (2 * job.nx - 1) * half, -half, (2 * job.ny - 1) * half)
    height = np.where(report.part.mask, report.part.top(*cell_centers(job.nx, job.ny, job.pitch)), np.nan)
    image = axes.imshow(height.T * UM_PER_M, origin="lower", extent=extent, interpolation="nearest", vmin=0.0)
    axes.figure.colorbar(image, ax=axes, label="top [µm]", shrink=0.7)
    marks = [report.narrow[name].cells for name in ("walls", "gaps") if name in report.narrow]
    if marks:
        shown = np.where(np.any(marks, axis=0), 1.0, np.nan)
        axes.imshow(shown.T, origin="lower", extent=extent, interpolation="nearest", cmap=ListedColormap([_NARROW]))
        axes.legend(handles=[Patch(color=_NARROW, label="narrow")], loc="upper right", fontsize=6)
    axes.axhline(_row(report.part) * job.pitch * MM_PER_M, color="black", linewidth=0.6, linestyle="--")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", title="from above")


def _solid(axes: Axes, part: Columns) -> None:
    """The part from the side, not to scale in height."""
    levels = (np.arange(_LEVELS) + 0.5) / _LEVELS * part.height
    filled: BoolMap = np.stack([part.inside(np.full((part.nx, part.ny), z)) for z in levels], axis=-1)
    low, high = (np.array([index[end] for index in map(np.unique, np.nonzero(filled)[:2])]) for end in (0, -1))
    shown = filled[low[0] : high[0] + 1, low[1] : high[1] + 1]
    width = max(shown.shape[:2]) * part.pitch
    upright = min(1.0, max(SOLID_UPRIGHT, part.height / width))
    seen = view(shown, upright)
    axes.imshow(seen.brightness, origin="lower", cmap="gray", vmin=0.0, vmax=1.0)
    axes.set_axis_off()
    draw_scales(axes, seen, width, part.height / upright)
    stretched = upright * width / part.height
    axes.set_title("solid" if 0.95 < stretched < 1.05 else f"solid, height x {stretched:.2g}")


def _cut(axes: Axes, part: Columns, job: Job) -> None:
    """Inks along a row of cells."""
    row = _row(part)
    z = (np.arange(_LEVELS) + 0.5) / _LEVELS * part.height
    x, y = (centers[:, row] for centers in cell_centers(job.nx, job.ny, job.pitch))
    filled = part.contains(x, y, z[:, None])
    region: Geometry = part if job.region is None else job.region
    in_b = filled & ~region.contains(x, y, z[:, None])
    shown = np.where(filled, np.where(in_b, 2.0, 1.0), 0.0)
    half = 0.5 * job.pitch * MM_PER_M
    extent = (-half, float(x[-1]) * MM_PER_M + half, 0.0, part.height * UM_PER_M)
    axes.imshow(shown, origin="lower", extent=extent, aspect="auto", **_INKS)
    axes.set(xlabel="x [mm]", ylabel="z [µm]", title="cut along the dashed line")


def _row(part: Columns) -> int:
    """The row of the cut: through the middle of the part."""
    return int(np.quantile(np.flatnonzero(part.mask.any(axis=0)), 0.5))
