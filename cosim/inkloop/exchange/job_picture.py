"""Picture of the target of a block: from above and as a cut."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from inkloop.component import BoolMap, FloatMap, Job
from inkloop.geometry import cell_centers
from inkloop.units import MM_PER_M, UM_PER_M

_INKS = ListedColormap(["#0b5fa5", "#e3c9a0"])
_FLAT: dict[str, Any] = {"cmap": _INKS, "interpolation": "nearest", "vmin": 0.0, "vmax": 1.0}
_LEVELS = 200  # of the cut, from the substrate to the top


def target_picture(job: Job, title: str) -> bytes:
    """A PNG; the same job gives the same bytes."""
    figure = Figure(figsize=(7.0, 2.8), layout="constrained")
    above, cut = figure.subplots(1, 2)
    _above(above, job)
    _cut(cut, job)
    figure.suptitle(title, fontsize=9)
    stream = BytesIO()
    figure.savefig(stream, dpi=150, format="png", facecolor="white", metadata={"Software": None})
    return stream.getvalue()


def _above(axes: Axes, job: Job) -> None:
    """Target heights; where there are two inks, those at half the height."""
    half = 0.5 * job.pitch * MM_PER_M
    right, back = ((2 * count - 1) * half for count in (job.nx, job.ny))
    extent = (-half, right, -half, back)
    x, y = cell_centers(job.nx, job.ny, job.pitch)
    if job.region is None:
        height = np.where(job.mask, job.target_height * UM_PER_M, np.nan)
        image = axes.imshow(height.T, origin="lower", extent=extent, interpolation="nearest", vmin=0.0)
        axes.figure.colorbar(image, ax=axes, label="target height [µm]")
    else:
        middle = np.full_like(x, 0.5 * job.target_height.max())
        axes.imshow(_inks(job, x, y, middle, job.mask).T, origin="lower", extent=extent, **_FLAT)
        axes.set_title("at half the height; blue: ink A, sand: ink B", fontsize=8)
    axes.axhline(_row(job) * job.pitch * MM_PER_M, color="black", linewidth=0.6, linestyle="--")
    axes.set(xlabel="x [mm]", ylabel="y [mm]")


def _cut(axes: Axes, job: Job) -> None:
    """Inks along a row of cells, each where it belongs up to the target."""
    row = _row(job)
    x, y = (centers[:, row] for centers in cell_centers(job.nx, job.ny, job.pitch))
    top = float(job.target_height.max())
    z = (np.arange(_LEVELS) + 0.5) / _LEVELS * top
    is_printed = job.mask[:, row] & (z[:, None] <= job.target_height[:, row])
    half = 0.5 * job.pitch * MM_PER_M
    extent = (-half, x[-1] * MM_PER_M + half, 0.0, top * UM_PER_M)
    axes.imshow(_inks(job, x, y, z[:, None], is_printed), origin="lower", extent=extent, aspect="auto", **_FLAT)
    axes.set(xlabel="x [mm]", ylabel="z [µm]")
    axes.set_title("cut along the dashed line", fontsize=8)


def _inks(job: Job, x: FloatMap, y: FloatMap, z: FloatMap, is_printed: BoolMap) -> FloatMap:
    """0 where ink A belongs, 1 for ink B, NaN where nothing is printed."""
    is_a = np.ones_like(is_printed) if job.region is None else job.region.contains(x, y, z)
    return np.where(is_printed, np.where(is_a, 0.0, 1.0), np.nan)


def _row(job: Job) -> int:
    """The row of the cut: the middle of the part, or next to it where inks may cross."""
    share = 0.5 if job.region is None else 0.25
    return int(np.quantile(np.flatnonzero(job.mask.any(axis=0)), share))
