"""The cuboid of Table II (Lu, Zheng, Mishra 2015), in 8 x 8 and 9 x 9 droplets, and its lateral growth."""

from __future__ import annotations

import numpy as np

from inkloop.component import FloatMap
from inkloop.report import layer_curves
from inkloop.results.result import Result
from inkloop.units import UM_PER_M
from inkloop_lab.reproduce import prints
from inkloop_lab.reproduce.comparison import Part, Row

PITCH_UM = 263.256
PRINTED = {"open loop": (18.5, 8.7), "paper's search": (22.3, 4.4)}
MACHINE = "the printed figures were measured on the authors' machine; no model here is fitted to it"
NO_GROWTH = (
    "the paper's cuboid was 10 % wider than the model, because droplets at the edges ran down; here ink beyond the "
    "edge stays where it fell, and the controllers jet on cells of the part only"
)


def find(quick: bool) -> Part:
    """Ten seeds (quick: two); layers in one pass, and the 8 x 8 in four, as the paper printed its corrections."""
    seeds = range(1, 3 if quick else 11)
    rows, shown = [], {}
    for side, passes in ((8, 1), (8, 4), (9, 1)):
        size = side * PITCH_UM
        overrides = {
            "grid": {"nx": side + 4, "ny": side + 4},
            "part": {"size_x_um": size, "size_y_um": size},
            "components.printer.passes": passes,
        }
        runs = prints.by_controller("cuboid", seeds, overrides)
        where = f"Table II: {side} x {side}, {passes} pass{'es' if passes > 1 else ''}"
        for label, results in runs.items():
            rows += _rows(where, label, results, side, of_paper=(side, passes) == (8, 4))
        if (side, passes) == (8, 4):
            shown = {label: results[0].dataset for label, results in runs.items()}
    return Part(rows, {"cuboid": layer_curves.cross_section(shown)})


def _rows(where: str, label: str, results: list[Result], side: int, *, of_paper: bool) -> list[Row]:
    printed = PRINTED.get(label, (None, None)) if of_paper else (None, None)
    heights = [result.final_height.values * UM_PER_M for result in results]
    part = results[0].dataset.mask.values.astype(bool)
    average, scatter = prints.mean_and_scatter([float(height[part].mean()) for height in heights])
    std, std_scatter = prints.mean_and_scatter([float(height[part].std()) for height in heights])
    grown = [
        prints.mean_and_scatter([100.0 * (width(height, axis) / side - 1.0) for height in heights]) for axis in (0, 1)
    ]
    remark = MACHINE if printed[0] is not None else ""
    growth = 10.0 if of_paper and label == "paper's search" else None
    within, note = (3.0, NO_GROWTH) if growth else (None, "")
    return [
        Row(where, f"{label}: average height", "µm", printed[0], average, remark=remark, scatter=scatter),
        Row(where, f"{label}: standard deviation", "µm", printed[1], std, remark=remark, scatter=std_scatter),
        *(
            Row(where, f"{label}: growth in {'xy'[axis]}", "%", growth, mean, within, note, spread)
            for axis, (mean, spread) in enumerate(grown)
        ),
    ]


def width(height: FloatMap, axis: int, half: float = 11.4) -> float:
    """Width of a block in cells where it is `half` [µm] high, mean over its inner lines along `axis`."""
    lines = np.moveaxis(height, axis, 1)
    inner = lines[4:-4]
    found = []
    for line in inner:
        above = np.flatnonzero(line >= half)
        if above.size == 0:
            found.append(0.0)
            continue
        first, last = above[0], above[-1]
        left = first - (line[first] - half) / (line[first] - line[first - 1])
        right = last + (line[last] - half) / (line[last] - line[last + 1])
        found.append(right - left)
    return float(np.mean(found))
