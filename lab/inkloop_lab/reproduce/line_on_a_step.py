"""Five droplets at the edge of a layer: the example that the paper explains its method with."""

from __future__ import annotations

import numpy as np

from inkloop.units import UM_PER_M
from inkloop_lab.models import YoungLaplaceDeposition
from inkloop_lab.models.young_laplace_deposition import FineSurface
from inkloop_lab.reproduce import pictures
from inkloop_lab.reproduce.comparison import Part, Row

CELLS, EDGE = 11, 6
"""The layer below covers the cells with j < EDGE."""


def find(quick: bool) -> Part:
    """Along the edge and across it; the paper prints a picture and no number."""
    per_pitch = 8 if quick else 16
    rows, shown = [], {}
    for name, sites in {
        "along the edge": [(i, EDGE - 1) for i in range(3, 8)],
        "across the edge": [(5, j) for j in range(3, 8)],
    }.items():
        for form in ("nonlinear", "linear"):
            model = YoungLaplaceDeposition(form=form, cells_per_pitch=per_pitch)
            below, after = _printed(model, sites)
            added = (after.over_grid - below.over_grid) * UM_PER_M
            kept = 100.0 * float(added.sum()) * (after.spacing * UM_PER_M) ** 2 / (5 * 30e3)
            beyond = added[:, EDGE * per_pitch :].sum() / added.sum()
            where = f"Fig. 3 to 5, {name}, {form}"
            rows += [
                Row(where, "highest point over the plate", "µm", None, float(after.over_grid.max()) * UM_PER_M),
                Row(where, "thickest place of the line", "µm", None, float(added.max())),
                Row(where, "volume beyond the edge", "%", None, 100.0 * float(beyond)),
                Row(where, "volume kept, of five droplets", "%", None, kept),
            ]
            shown[f"{name}, {form}"] = (below, after)
    return Part(rows, {"line-on-a-step": pictures.lines_on_a_step(shown)})


def _printed(model: YoungLaplaceDeposition, sites: list[tuple[int, int]]) -> tuple[FineSurface, FineSurface]:
    """Surface of one full layer up to the edge, and with the five droplets on it.

    Across the edge the grid is turned, because lines lie along x.
    """
    layer, line = np.zeros((CELLS, CELLS), dtype=np.int32), np.zeros((CELLS, CELLS), dtype=np.int32)
    layer[1:-1, 1:EDGE] = 1
    line[tuple(np.transpose(sites))] = 1
    turned = len({i for i, _ in sites}) == 1
    if turned:
        layer, line = layer.T.copy(), line.T.copy()
    below = model.layer(model.start(np.zeros((CELLS, CELLS))), layer)
    after = model.layer(below, line, 2)
    if not turned:
        return below, after
    back = [FineSurface(s.height.T, s.fine.T, s.spacing, s.rim, s.fallbacks, s.lost) for s in (below, after)]
    return back[0], back[1]
