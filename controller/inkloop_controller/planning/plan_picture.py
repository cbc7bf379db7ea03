"""A picture of the coming layers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from inkloop.component import FloatMap
from inkloop.units import UM_PER_M
from inkloop_controller.problem.horizon_problem import IntPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANEL_IN = 2.2
"""Side of the map of one layer, in inches."""


def plan_picture(plan: IntPlan, predicted: FloatMap, title: str) -> Figure:
    """The droplets of each planned layer (layers, nx, ny), and the surface [m] that is expected of the first one.

    Each kind of droplet has a colour.
    """
    from matplotlib.figure import Figure

    layers, shape = len(plan), predicted.shape
    size = PANEL_IN * (layers + 1) + 1.0, PANEL_IN * shape[1] / shape[0] + 0.6
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(1, layers + 1, squeeze=False)[0]
    kinds = max(1, int(plan.max()))
    for number, (axes, droplets) in enumerate(zip(panels, plan, strict=False), 1):
        axes.imshow(np.ma.masked_equal(droplets, 0).T, origin="lower", cmap="Blues", vmin=0, vmax=kinds)
        axes.set_title(f"layer {number}: {np.count_nonzero(droplets)} droplets", fontsize=8)
    surface = panels[layers].imshow(predicted.T * UM_PER_M, origin="lower", cmap="cividis")
    panels[layers].set_title("expected after layer 1", fontsize=8)
    figure.colorbar(surface, ax=panels[layers], label="height [µm]")
    for axes in panels:
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_facecolor("0.95")
    figure.suptitle(title, fontsize=9)
    return figure
