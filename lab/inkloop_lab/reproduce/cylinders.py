"""The cylinders of Fig. 11 and 12 (Lu, Zheng, Mishra 2015): open loop, the paper's search, and ours on one plant."""

from __future__ import annotations

from functools import partial

from inkloop.report.layer_curves import cross_section
from inkloop.report.surface_picture import surfaces
from inkloop.units import UM_PER_M
from inkloop_lab.reproduce import prints
from inkloop_lab.reproduce.comparison import Part, Row, Step

FIGURES = {
    0.2: ("Fig. 11: cylinder, 20 %", (44.1, 15.0), (0.7, 4.1)),
    0.4: ("Fig. 12: cylinder, 40 %", (84.7, 16.6), (1.9, 4.5)),
}
"""Variation -> place, mean error and standard deviation as printed [µm], open and closed loop."""
NO_SPREAD = (
    "the printed unevenness of the open loop does not follow from the paper's own model with independent droplets: "
    "missing volume averages out over 53 layers and the rim loses a known amount"
)
SIGNS = (
    "absolute mean error: the size of a print's mean error, mean over the prints; the paper prints sizes. Elsewhere "
    "the mean error has a sign, and those of several prints cancel in their mean"
)
OTHER_PLANT = "printed on a slightly different plant, as the open loop shows; compare the rows of one plant"


def find(quick: bool, *, variation: float) -> Part:
    """Mean over ten seeds (quick: two)."""
    where, open_loop, closed_loop = FIGURES[variation]
    seeds = range(1, 3 if quick else 11)
    runs = prints.by_controller("cylinder", seeds, {"components.printer.variation": variation})
    rows = []
    for label, results in runs.items():
        metrics = [result.metrics() for result in results]
        bias, scatter = prints.mean_and_scatter([abs(one["mean_error"]) * UM_PER_M for one in metrics])
        std, std_scatter = prints.mean_and_scatter([one["std"] * UM_PER_M for one in metrics])
        printed = {"open loop": open_loop, "paper's search": closed_loop}.get(label, (None, None))
        is_open = label == "open loop"
        near, remark = (1.0, NO_SPREAD) if is_open else (None, "" if printed[0] is None else OTHER_PLANT)
        remark_of_mean = SIGNS if printed[0] is None else "" if is_open else remark
        rows += [
            Row(where, f"{label}: absolute mean error", "µm", printed[0], bias, near, remark_of_mean, scatter),
            Row(where, f"{label}: standard deviation", "µm", printed[1], std, near, remark, std_scatter),
        ]
    shown = {label: results[0].dataset for label, results in runs.items()}
    name = f"cylinder-{variation * 100:.0f}"
    return Part(rows, {name: cross_section(shown), f"{name}-surfaces": surfaces(shown)})


STEPS = tuple(Step(where, partial(find, variation=variation)) for variation, (where, _, _) in FIGURES.items())
